"""Whom two cameras teach while two people are seen: one person, by where they stand."""

import numpy as np
import pytest
from standing_person import person

from common import SECOND_NS
from common.floor_place import FloorPlace
from common.teaching_messages import TaughtPlace, TeachRequest
from observer.geometry.projection import pinhole_matrix, project
from observer.geometry.views import View
from observer.motion.projected import ProjectedPeople
from observer.prepared_tracks import PreparedTracker
from observer.runtime.people_observer import FloorPlacer
from observer.teaching.taught_person import TaughtPerson
from observer.tracking.person_keeper import of_people
from observer.tracks import WHOLE_BODY, Frame

CORNERS = [
    View(name, pinhole_matrix(turn, 0.3, 4.0, 500.0, (320, 240), (0.0, 0.9, 0.0)), None, (640, 480))
    for name, turn in (("corner0", 0.3), ("corner1", 3.3))
]


class Camera:
    """Two recorded people before one camera, whose keeper numbers them in the order in which it sees them."""

    def __init__(self, view):
        self.view, self.n = view, 0
        self.tracker = PreparedTracker(ProjectedPeople(view, of_people(WHOLE_BODY, 2), 2), WHOLE_BODY, view)
        self.taught = TaughtPerson(FloorPlacer(view, None, alone=False))

    def ask(self, command, place=None):
        self.taught.expect(TeachRequest(command=command, teacher="anna", place=place), self.now_s)

    def see(self, *places):
        self.n += 1
        bodies = [person(*at) for at in places] + [np.full((15, 3), np.nan)] * (2 - len(places))
        self.tracker.update(Frame(self.n * SECOND_NS // 15, np.concatenate(bodies)))
        return self.taught.tracks(self.tracker, 0, self.now_s)

    def sees(self, tracks, at):
        """Whether these tracks are of the one who stands there."""
        wanted = project(self.view.matrix, person(*at))
        return bool(np.nanmedian(np.hypot(*(tracks.centres - wanted).T)) < 20)

    @property
    def now_s(self):
        return self.n / 15

    @property
    def place(self):
        own = self.taught.place
        return None if own is None else TaughtPlace(at=list(own.at), covariance=list(own.covariance))


LEFT, RIGHT = (0.9, 0.0), (-0.9, 0.2)


@pytest.fixture
def cameras():
    return [Camera(view) for view in CORNERS]


def test_without_a_teacher_who_knows_it_is_the_first(cameras):
    camera = cameras[0]
    camera.ask("begin")
    for _ in range(3):
        tracks = camera.see(LEFT, RIGHT)
    assert camera.sees(tracks, LEFT) and tracks.people.count == 2 and camera.place.at == pytest.approx(LEFT, abs=0.3)


def test_cameras_that_number_people_differently_learn_from_the_same_one(cameras):
    one, other = cameras
    one.see(LEFT), other.see(RIGHT)
    for camera in cameras:
        camera.ask("begin")
    for _ in range(5):
        one.see(LEFT, RIGHT), other.see(RIGHT, LEFT)
    assert other.taught.place.at == pytest.approx(RIGHT, abs=0.4), "each would learn from the first it has seen"
    for camera in cameras:
        camera.ask("begin", one.place)
    for _ in range(5):
        seen = one.see(LEFT, RIGHT), other.see(RIGHT, LEFT)
        assert all(camera.sees(tracks, LEFT) for camera, tracks in zip(cameras, seen, strict=True))
        for camera in cameras:
            camera.ask("status", one.place)
    # They change places and the ids stay: so does the person.
    for step in np.linspace(0, 1, 40):
        apart = (0.9 - 1.8 * step, 0.6), (-0.9 + 1.8 * step, -0.6)
        for camera in cameras:
            camera.ask("status", one.place)
        seen = one.see(*apart), other.see(*reversed(apart))
    assert all(camera.sees(tracks, apart[0]) for camera, tracks in zip(cameras, seen, strict=True))


def test_nobody_is_taught_where_nobody_fits_or_two_do(cameras):
    camera = cameras[0]
    between = TaughtPlace(at=[0.0, 0.1], covariance=[0.04, 0.0, 0.04])
    for place in (between, TaughtPlace(at=[5.0, 5.0], covariance=[0.04, 0.0, 0.04])):
        camera.ask("begin", place)
        tracks = camera.see((0.3, 0.1), (-0.3, 0.1)) if place is between else camera.see(LEFT, RIGHT)
        assert not tracks.visible.any() and camera.place is None and "not sure" in camera.taught.complaint
    camera.ask("leave"), camera.ask("begin")
    assert camera.see(LEFT, RIGHT).visible.any() and not camera.taught.complaint


def test_a_camera_that_has_lost_whom_it_teaches_learns_from_nobody_until_another_one_knows(cameras):
    camera, place = cameras[0], TaughtPlace(at=list(LEFT), covariance=[0.04, 0.0, 0.04])
    camera.ask("begin", place)
    assert camera.sees(camera.see(LEFT, RIGHT), LEFT)
    camera.ask("status", camera.place)
    for _ in range(30):  # both are away for longer than the tracker remembers them, and come back at each other's place
        camera.see()
    assert not camera.see(RIGHT, LEFT).visible.any() and camera.place is None and "not sure" in camera.taught.complaint
    camera.ask("status", place)
    assert camera.sees(camera.see(RIGHT, LEFT), LEFT)
    for _ in range(30):
        camera.see()
    # Who alone is seen is taught: the others were sent away.
    assert camera.sees(camera.see(LEFT), LEFT) and camera.sees(camera.see(LEFT, RIGHT), LEFT)
    camera.ask("leave")
    assert camera.see(LEFT, RIGHT).visible.any()


def test_the_distance_of_two_places_is_that_of_mahalanobis():
    rng = np.random.default_rng(0)
    for _ in range(20):
        places, spread = [], np.zeros((2, 2))
        for _ in range(2):
            root = rng.normal(size=(2, 2))
            covariance = root @ root.T + 0.01 * np.eye(2)
            spread += covariance + 0.04 * np.eye(2)
            xx, xz, zz = float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])
            places.append(FloorPlace(at=tuple(rng.normal(size=2).tolist()), covariance=(xx, xz, zz)))
        apart = np.subtract(places[0].at, places[1].at)
        assert places[0].distance(places[1]) == pytest.approx(apart @ np.linalg.solve(spread, apart) / 2)
