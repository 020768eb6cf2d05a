"""Where observers stand on the page's floor."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hub.dashboard.placement import MIN_DISTANCE_DEG, azimuth_of, azimuth_of_camera, floor_positions


def distance(a, b):
    return abs((a - b + 180) % 360 - 180)


@pytest.mark.parametrize(
    ("view", "angle"),
    [("door", 0), ("wheel", 90), ("yaw:45", 45), ("yaw:-45,pitch:10", 315), ("table", None), ("a.toml", None),
     ("yaw:x", None), ("yaw:nan", None), ("yaw:", None), ("", None)],
)  # fmt: skip
def test_the_angle_of_a_view(view, angle):
    assert azimuth_of(view) == angle


def looking_from(angle_deg, height_m, parallel=False, sign=1.0):
    """A camera 3 m away at that angle and height, looking at the origin; y up, the front is -z."""
    a = math.radians(angle_deg)
    centre = (3 * math.sin(a), height_m, -3 * math.cos(a))
    size = math.hypot(*centre)
    forward = [-value / size for value in centre]
    right = [-math.cos(a), 0.0, -math.sin(a)]
    down = [forward[1] * right[2] - forward[2] * right[1], forward[2] * right[0] - forward[0] * right[2],
            forward[0] * right[1] - forward[1] * right[0]]  # fmt: skip
    rows = [[*right, 0.0], [*down, 0.0], [0.0, 0.0, 0.0, 1.0] if parallel else [*forward, size]]
    return [[sign * value for value in row] for row in rows]


@given(st.floats(0, 359.9), st.floats(-2, 2), st.sampled_from([1.0, -2.0]))
def test_the_side_of_a_camera_is_read_from_its_matrix(angle, height, sign):
    assert distance(azimuth_of_camera(looking_from(angle, height, sign=sign)), angle) < 1e-6
    assert distance(azimuth_of_camera(looking_from(angle, height, parallel=True)), angle) < 1e-6


@pytest.mark.parametrize("matrix", [None, [], [[0.0] * 4] * 3, [["x"] * 4] * 3, [[math.nan] * 4] * 3, 5])
def test_an_invalid_matrix_has_no_side(matrix):
    assert azimuth_of_camera(matrix) is None


def test_unknown_observers_stand_in_the_corners_or_in_the_widest_gap():
    corners = floor_positions(dict.fromkeys(("a", "b", "c", "d"), "table"), {}).values()
    assert [each.azimuth_deg for each in corners] == [45, 135, 225, 315] and not any(each.known for each in corners)
    mixed = floor_positions({"a": "door", "b": "wheel", "c": "x.toml"}, {"a": 0.0, "b": 90.0})
    assert [mixed[name].azimuth_deg for name in "abc"] == [0, 90, 225]


@given(st.lists(st.floats(0, 359.9) | st.none(), min_size=1, max_size=30))
def test_none_stands_upon_another(angles):
    views = {f"cam{i}": "view" for i in range(len(angles))}
    positions = floor_positions(views, dict(zip(views, angles, strict=True)))
    at = [each.azimuth_deg for each in positions.values()]
    least = min(MIN_DISTANCE_DEG, 0.9 * 360 / len(at))
    assert list(positions) == list(views) and all(0 <= angle < 360 for angle in at)
    assert all(distance(a, b) > 0.5 * least for i, a in enumerate(at) for b in at[:i])
