"""Names of views, and the performer turned in front of them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from observer_stage import rejected

from observer.effort.reader import depth_in
from observer.geometry.camera_file import CameraModel, write_camera
from observer.geometry.projection import parallel_matrix, pinhole_matrix, project
from observer.geometry.views import View, facing, parse_view, split_views, turned

DEGREES = st.integers(-180, 180)
POSITIONS = arrays(np.float64, (4, 3, 3), elements=st.floats(-2, 2).map(lambda x: round(x, 3)))


@pytest.mark.parametrize(
    ("text", "yaw_deg", "pitch_deg"),
    [
        ("door", 0, 0),
        ("wheel", 90, 0),
        ("table", 0, 90),
        ("yaw:45", 45, 0),
        (" yaw:-30.5 , pitch:10 ", -30.5, 10),
        ("yaw:0,pitch:-90", 0, -90),
    ],
)
def test_planes_and_angles(text, yaw_deg, pitch_deg):
    view = parse_view(text)
    assert view.name == text.replace(" ", "")
    np.testing.assert_allclose(view.matrix, parallel_matrix(math.radians(yaw_deg), math.radians(pitch_deg)), atol=1e-15)


@given(yaw=st.floats(-3.1, 3.1), pitch=st.floats(-1.4, 1.4), scale=st.sampled_from([1.0, -0.01]))
def test_facing_and_depth_are_the_cosine_and_sine_of_the_yaw_of_any_camera(yaw, pitch, scale):
    """Wherever its principal point is, and however large or small its matrix."""
    for matrix in (parallel_matrix(yaw, pitch), scale * pinhole_matrix(yaw, pitch, 3.0, 500.0, (900.0, 50.0))):
        assert facing(View("one", matrix)) == pytest.approx(math.cos(yaw), abs=1e-9)
        assert depth_in(matrix) == pytest.approx(-math.sin(yaw), abs=1e-9)


def test_a_camera_file_is_relative_to_the_folder(tmp_path):
    matrix = pinhole_matrix(0.1, 0.2, 3.0, 800, (640, 360))
    write_camera(tmp_path / "left.toml", CameraModel("left", matrix))
    for view in (parse_view("left.toml", tmp_path), parse_view(str(tmp_path / "left.toml"))):
        assert view.name == "left"
        np.testing.assert_array_equal(view.matrix, matrix)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("dor", "did you mean door"),
        ("side", "known: door, wheel, table"),
        ("", "known:"),
        ("yaw:", "'' is not an angle"),
        ("yaw:left", "'left' is not an angle"),
        ("yaw:nan", "not an angle"),
        ("yaw:inf", "not an angle"),
        ("yaw:45,10", "a pitch is expected"),
        ("yaw:45,", "a pitch is expected"),
        ("yaw:45,pitch:x", "'x' is not an angle"),
        ("yaw:45,pitch:91", "pitch is -90"),
        ("yaw:45,pitch:10,pitch:5", "not an angle"),
        ("pitch:10", "known:"),
        ("nowhere.toml", "nowhere.toml"),
    ],
)
def test_other_names_are_rejected_with_one_line(text, message):
    with rejected(message):
        parse_view(text)


@pytest.mark.parametrize(
    ("text", "views"),
    [
        ("door", ["door"]),
        ("door,wheel,yaw:45,pitch:10", ["door", "wheel", "yaw:45,pitch:10"]),
        ("yaw:0,pitch:5, yaw:90 ,left.toml", ["yaw:0,pitch:5", "yaw:90", "left.toml"]),
        ("yaw:1,yaw:2,pitch:3", ["yaw:1", "yaw:2,pitch:3"]),
    ],
)
def test_split(text, views):
    assert split_views(text) == views


@pytest.mark.parametrize("text", ["", "door,,wheel", "door,", "pitch:10", "door,pitch:10", "yaw:1,pitch:2,pitch:3"])
def test_split_rejects(text):
    with rejected("views"):
        split_views(text)


@given(POSITIONS, DEGREES, DEGREES)
def test_turning_equals_moving_the_camera(positions, turn, yaw):
    view = parallel_matrix(math.radians(yaw), 0.2)
    further = parallel_matrix(math.radians(yaw + turn), 0.2)
    after = turned(positions, math.radians(turn), np.zeros(3))
    np.testing.assert_allclose(project(view, after), project(further, positions), atol=1e-12)
    # Where he stands himself, the same up to one shift.
    shift = project(view, turned(positions, math.radians(turn))) - project(further, positions)
    np.testing.assert_allclose(shift, np.broadcast_to(shift[0, 0], shift.shape), atol=1e-12)


@given(POSITIONS, DEGREES)
def test_turning_preserves_distances_and_heights(positions, turn):
    positions = positions.astype(np.float32)
    after = turned(positions, math.radians(turn))
    assert after.dtype == positions.dtype
    np.testing.assert_array_equal(after[..., 1], positions[..., 1])
    np.testing.assert_allclose(after.mean(axis=(0, 1)), positions.mean(axis=(0, 1)), atol=1e-5)
    before_m, after_m = (np.linalg.norm(p[..., 0, :] - p[..., 1, :], axis=-1) for p in (positions, after))
    np.testing.assert_allclose(after_m, before_m, atol=1e-5)
    np.testing.assert_allclose(turned(after, -math.radians(turn)), positions, atol=1e-5)


def test_nan_stays_nan_and_does_not_move_the_axis():
    positions = np.array([[[1.0, 0, 2], [np.nan] * 3, [3, 1, 4]]])
    after = turned(positions, math.pi)
    np.testing.assert_allclose(after[0, [0, 2]], [[3, 0, 4], [1, 1, 2]], atol=1e-12)
    assert np.isnan(after[0, 1]).all()
    assert np.isnan(turned(np.full((2, 3), np.nan), 1.0)).all()
