"""Several people by a pose model: a scripted model that finds the people of a drawn picture."""

import numpy as np
import pytest

from common import SECOND_NS
from observer.tracking.people import Body, Pose
from observer.tracking.several_poses import POSE_LOST_S, SeveralPoses
from observer.tracks import WHOLE_BODY, Frame

SIZE = 640, 480
HEIGHT = 200.0
HEIGHTS = {30: 120.0}
"""Of somebody in the background."""
SHAPES = {c: np.random.default_rng(n).uniform(-0.12, 0.12, (33, 2)) for n, c in enumerate((60, 90, 180, 30))}


def picture(people):
    """People are squares of one shade: shade -> u of their middle."""
    shown = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    for shade, u in people.items():
        shown[230:250, round(u) - 10 : round(u) + 10] = shade
    return shown


class Drawn:
    """A `PersonModel`: finds the squares, and the pose of the one nearest to where it is told to look."""

    opened = 0

    def __init__(self):
        Drawn.opened += 1

    def _people(self, rgb, left=0):
        row = rgb[240, :, 0] if len(rgb) > 240 else rgb[0, :, 0]
        return [
            (shade, left + float(np.flatnonzero(row == shade).mean()))
            for shade in sorted(SHAPES)
            if (row == shade).any()
        ]

    def find(self, rgb, area, ms):
        cut = rgb[:, area.left : area.left + area.width]
        return [Body(u, 240.0, HEIGHTS.get(shade, HEIGHT)) for shade, u in self._people(cut, area.left)]

    def pose(self, rgb, body, ms):
        near = min(self._people(rgb), key=lambda each: abs(each[1] - body.u), default=None)
        if near is None or abs(near[1] - body.u) > 100:
            return None
        shade, u = near
        marks = SHAPES[shade] * HEIGHT / 0.3 + [u, 240.0]
        return Pose(np.column_stack([marks / SIZE, np.ones(33)]), Body(u, 240.0, HEIGHTS.get(shade, HEIGHT)))

    def restart(self):
        pass

    def close(self):
        Drawn.opened -= 1


class Film:
    def __init__(self, most=2):
        self.tracker, self.n = SeveralPoses(Drawn, "drawn", most), 0

    def show(self, **people):
        """One more picture at 15 Hz: id -> u of those who are seen."""
        self.n += 1
        shown = picture({int(shade[1:]): u for shade, u in people.items()})
        tracks = self.tracker.update(Frame(round(self.n * SECOND_NS / 15), shown))
        seen = {p.id: round(p.u) for p in tracks.persons if np.isfinite(p.centres).any()}
        assert tracks.people.count == len(tracks.persons)
        return seen


@pytest.fixture
def film():
    Drawn.opened = 0
    made = Film()
    yield made
    made.tracker.close()
    assert Drawn.opened == 0


def test_both_are_found_and_kept_while_they_pass_each_other(film):
    first = film.show(a60=150, b90=450)
    assert sorted(first.values()) == [150, 450]
    for step in range(1, 31):
        shown = film.show(a60=150 + 10 * step, b90=450 - 10 * step)
    ids = {u: n for n, u in first.items()}
    assert shown.get(ids[150]) in (450, None) and shown.get(ids[450]) in (150, None)


def test_who_comes_later_is_found_without_disturbing_the_first(film):
    (one,) = film.show(a60=150)
    for _ in range(20):
        shown = film.show(a60=150, b90=450)
    assert shown[one] == 150 and sorted(shown.values()) == [150, 450]


def test_who_leaves_frees_a_copy_of_the_model_for_the_next(film):
    film.show(a60=150, b90=450)
    for _ in range(round(15 * (POSE_LOST_S + 2.5))):
        film.show(a60=150)
    for _ in range(20):
        shown = film.show(a60=150, c180=550)
    assert sorted(shown.values()) == [150, 550] and Drawn.opened == 2


def test_no_more_than_wanted_are_followed(film):
    for _ in range(20):
        shown = film.show(a60=100, b90=320, c180=550)
    assert len(shown) == 2


def test_of_more_people_than_are_followed_those_in_the_background_are_left_out(film):
    """They come first where a search finds them first."""
    for _ in range(10):
        shown = film.show(a30=60, b90=320, c180=550)
    assert sorted(shown.values()) == [320, 550]


def test_an_empty_room_is_complained_of(film):
    for _ in range(60):
        assert film.show() == {}
    assert "finds nobody" in film.tracker.complaint
    assert tuple(film.tracker.body_parts) == WHOLE_BODY


class Coarse(Drawn):
    """Its detector is 30 px beside the person; a pose is off by a third of how far the place it was told is."""

    def find(self, rgb, area, ms):
        return [Body(body.u + 30, body.v, body.height) for body in super().find(rgb, area, ms)]

    def pose(self, rgb, body, ms):
        seen = super().pose(rgb, body, ms)
        error = (body.u - seen.body.u) / 3
        moved = seen.landmarks + np.array([error / SIZE[0], 0, 0])
        return Pose(moved, Body(seen.body.u + error, seen.body.v, seen.body.height))


def test_the_first_pose_of_somebody_does_not_have_the_detectors_error():
    tracker = SeveralPoses(Coarse, "drawn", 2)
    tracks = tracker.update(Frame(0, picture({60: 150, 90: 450})))
    assert sorted(p.u for p in tracks.persons) == pytest.approx([150, 450], abs=4)
    tracker.close()
