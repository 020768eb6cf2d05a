"""A pose model that finds one person in the picture that it gets, looked at through squares of a larger picture."""

import numpy as np
import pytest

from observer.tracking.mediapipe_pose import TALL_TORSOS, CroppedPeople, body_of
from observer.tracking.people import Body, SearchArea
from observer.tracking.person_follower import PersonFollower

SIZE = (640, 480)


class Finds:
    """A `PoseModel` that finds a white figure: nose at its top, hips in the middle, ankles at its bottom."""

    def __init__(self):
        self.sizes, self.times, self.forgotten = [], [], 0

    def landmarks(self, rgb, ms):
        self.sizes.append(rgb.shape[:2])
        self.times.append(ms)
        rows, columns = np.nonzero(rgb[..., 0])
        if not len(rows):
            return None
        height, width = rgb.shape[:2]
        left, right, top, bottom = columns.min(), columns.max() + 1, rows.min(), rows.max() + 1
        landmarks = np.full((33, 3), 0.9)
        landmarks[:, :2] = (left + right) / 2 / width, (top + bottom) / 2 / height
        shoulders = (top + bottom) / 2 - 0.3 * (bottom - top)
        for n, v in ((11, shoulders), (27, bottom)):
            landmarks[[n, n + 1], 1] = v / height
        landmarks[0, 1] = top / height
        landmarks[11:33:2, 0], landmarks[12:33:2, 0] = right / width, left / width
        return landmarks

    def forget(self, ms):
        self.forgotten += 1
        self.times.append(ms)

    def close(self):
        pass


def picture(u, v, height=100):
    drawn = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    drawn[v - height // 2 : v + height // 2, u - height // 8 : u + height // 8] = 255
    return drawn


def test_a_person_who_walks_is_found_where_they_are_and_the_square_moves_seldom():
    model = Finds()
    follower = PersonFollower(CroppedPeople(model))
    for n, u in enumerate(range(100, 540, 10)):
        landmarks = follower.landmarks(picture(u, 240), 1 + 100 * n)
        np.testing.assert_allclose(landmarks[[23, 24], :2].mean(axis=0) * SIZE, (u, 240), atol=2)
    assert model.forgotten <= 30  # at most with each search for others, and as the square moves
    assert all(later > earlier for earlier, later in zip(model.times, model.times[1:], strict=False))
    assert min(max(size) for size in model.sizes) <= 260


def test_the_square_stands_still_while_the_person_is_inside():
    model = Finds()
    people = CroppedPeople(model)
    body = Body(300, 240, 100)
    for n, u in enumerate((300, 310, 320, 310, 290, 280)):
        body = people.pose(picture(u, 240), body, 1 + n).body
        assert abs(body.u - u) < 2
    assert model.forgotten == 1
    people.pose(picture(300, 240), Body(100, 100, 100), 10)
    assert model.forgotten == 2


@pytest.mark.parametrize("height", [330, 470])
def test_of_a_large_person_the_whole_picture_is_used(height):
    model = Finds()
    CroppedPeople(model).pose(picture(300, 240, height), Body(300, 240, height), 1)
    assert model.sizes == [(480, 640)]


def test_people_are_found_in_a_part_of_the_picture():
    people = CroppedPeople(Finds())
    (body,) = people.find(picture(500, 300), SearchArea(400, 200, 200, 200), 1)
    assert abs(body.u - 500) < 2
    assert abs(body.v - 300) < 2
    assert people.find(picture(100, 100), SearchArea(400, 200, 200, 200), 2) == []


def test_a_model_that_finds_everybody_is_asked_for_them():
    model = Finds()
    one = model.landmarks(picture(100, 240), 1)
    model.everybody = lambda rgb: [one, np.add(one, [0.5, 0, 0])]
    bodies = CroppedPeople(model).find(picture(100, 240), SearchArea(0, 0, *SIZE), 2)
    assert [round(body.u) for body in bodies] == [100, 420]


def test_a_body_without_visible_hips_has_a_place_and_a_height():
    landmarks = np.zeros((33, 3))
    landmarks[[0, 11, 12, 15]] = (0.5, 0.2, 0.9), (0.6, 0.4, 0.9), (0.4, 0.4, 0.9), (0.6, 0.6, 0.9)
    body = body_of(landmarks, SIZE)
    assert 250 < body.u < 400
    assert 150 < body.v < 250
    assert body.height > 190


@pytest.mark.parametrize(("shoulders", "hips", "span"), [((100, 50), (0, 150), 100), ((100, 50), (0, 50), 100)])
def test_the_height_follows_from_the_torso_or_from_above_from_the_shoulders(shoulders, hips, span):
    """Width and row of the shoulders and of the hips, px: 100 px of torso, or 100 px across."""
    landmarks = np.zeros((33, 3))
    for rows, (width, v) in (((11, 12), shoulders), ((23, 24), hips)):
        landmarks[list(rows)] = [[(320 + width / 2) / 640, v / 480, 0.9], [(320 - width / 2) / 640, v / 480, 0.9]]
    body = body_of(landmarks, SIZE)
    assert body.height == pytest.approx(TALL_TORSOS * span) and (body.u, body.v) == pytest.approx((320, hips[1]))
