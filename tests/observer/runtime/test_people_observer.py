"""An observer of several people: a belief for each, a new one for a new id, and where each one is."""

import numpy as np
import pytest
from standing_person import person

from common import SECOND_NS
from common.messages import PosteriorMessage
from common.vocabulary import Vocabulary
from common.wire import decode
from observer.foreign import ForeignPeople, frame_of_line
from observer.geometry.projection import pinhole_matrix, project
from observer.geometry.views import THIS_CAMERA_MATRIX, View
from observer.motion.projected import ProjectedPeople
from observer.prepared_tracks import PreparedTracker
from observer.runtime.people_observer import FloorPlacer, PeopleObserver
from observer.runtime.pipeline import Posterior
from observer.runtime.scene_inputs import follows_one, people_followed
from observer.runtime.service import PosteriorPublisher
from observer.tracking.person_keeper import of_people
from observer.tracks import WHOLE_BODY, Frame

NAMES = Vocabulary(("bowing", "lunging"))
CAMERA = View("corner", pinhole_matrix(0.3, 0.3, 4.0, 500.0, (320, 240), (0.0, 0.9, 0.0)), None, (640, 480))


class Counting:
    """In place of an `Observer`: counts the frames, and those in which something of its person was seen."""

    vocabulary, body_parts, leans_on = NAMES, WHOLE_BODY, None

    def __init__(self, tracker):
        self.tracker, self.frames, self.seen = tracker, 0, 0

    def step(self, frame):
        self.frames += not frame.repeated
        self.seen += bool(self.tracker.update(frame).visible.any())
        return Posterior(np.array([0.5, 0.5]), 0.9, self.frames, {"head": True}, unlearned=self.seen / 1000)

    def end(self):
        return Posterior(np.array([0.5, 0.5]), 1.0, self.frames, {})


class Room:
    """Two recorded people before one camera, and an observer of them."""

    def __init__(self, view=CAMERA, alone=False):
        self.view, self.n = view, 0
        tracker = PreparedTracker(ProjectedPeople(view, of_people(WHOLE_BODY, 2), 2), ("head", "left_hand"), view)
        self.observer = PeopleObserver(tracker, Counting, FloorPlacer(view, None, alone=alone))

    def see(self, *places, repeated=False):
        """The posterior after one more frame with people at these places."""
        self.n += not repeated
        people = [person(*at) for at in places] + [np.full((15, 3), np.nan)] * (2 - len(places))
        content = np.concatenate(people)
        return self.observer.step(Frame(self.n * SECOND_NS // 15, content, repeated=repeated))


def test_each_person_has_a_posterior_with_an_id_and_a_place():
    room = Room()
    for _ in range(5):
        left = room.see((0.8, 0.0), (-0.8, 0.2))
    (right,) = left.others
    assert (left.person, right.person) == ("1", "2") and left.frames == right.frames == 5
    assert left.place.at == pytest.approx((0.8, 0.0), abs=0.2)
    assert right.place.at == pytest.approx((-0.8, 0.2), abs=0.2)


def test_with_nobody_there_is_a_posterior_of_nobody_and_who_comes_begins_anew():
    room = Room()
    empty = room.see()
    assert empty.person is None and empty.place is None and empty.others == ()
    assert room.see((0.5, 0.0)).frames == 1
    for _ in range(40):
        room.see()
    again = room.see((0.5, 0.0))
    assert (again.person, again.frames) == ("2", 1)


def test_who_is_hidden_for_a_moment_keeps_the_belief():
    room = Room()
    for _ in range(5):
        room.see((0.8, 0.0), (-0.8, 0.2))
    hidden = room.see((0.8, 0.0))
    assert [each.person for each in hidden.others] == ["2"] and hidden.others[0].place is None
    assert room.see((0.8, 0.0), (-0.8, 0.2)).others[0].frames == 7


def test_a_repeated_frame_updates_nothing():
    room = Room()
    room.see((0.8, 0.0), (-0.8, 0.2))
    assert room.see((0.8, 0.0), (-0.8, 0.2), repeated=True).frames == 1


def test_at_the_end_of_the_source_everybody_ends():
    room = Room()
    room.see((0.8, 0.0), (-0.8, 0.2))
    end = room.observer.end()
    assert (end.person, end.rest, [each.person for each in end.others]) == ("1", 1.0, ["2"])
    assert Room().observer.end() is None


def test_whose_trunk_is_behind_somebody_is_seen_in_part():
    view = View("level", pinhole_matrix(0.0, 0.0, 4.0, 500.0, (320, 240), (0.0, 0.9, 0.0)), None, (640, 480))
    tracker = ProjectedPeople(view, of_people(WHOLE_BODY, 2), 2)
    persons = tracker.update(Frame(0, np.concatenate([person(0, -0.5), person(0.05, 0.5)]))).persons
    near, far = sorted(persons, key=lambda each: -each.height)
    hidden = {part for part, at in zip(WHOLE_BODY, far.centres, strict=True) if np.isnan(at).any()}
    assert np.isfinite(near.centres).all() and {"neck", "pelvis"} <= hidden < set(WHOLE_BODY)


def test_an_only_camera_without_a_place_tells_people_apart_by_its_picture():
    placer = FloorPlacer(View("camera", THIS_CAMERA_MATRIX), None, alone=True)
    room = Room()
    room.see((0.8, 0.0), (-0.8, 0.2))
    first, second = room.observer._tracker.persons()
    left, right = (placer.place(WHOLE_BODY, each, 640) for each in (first, second))
    apart = np.hypot(*np.subtract(left.at, right.at))
    assert apart == pytest.approx(1.6, abs=0.4)
    assert FloorPlacer(View("camera", THIS_CAMERA_MATRIX), None, alone=False).place(WHOLE_BODY, first, 640) is None


def test_all_posteriors_of_a_frame_are_published_with_numbers_of_their_own():
    sent = []
    publisher = PosteriorPublisher(NAMES, type("Link", (), {"put": lambda self, payload: sent.append(payload)})())
    room = Room()
    publisher.publish(room.see((0.8, 0.0), (-0.8, 0.2)), SECOND_NS, SECOND_NS)
    messages = [decode(PosteriorMessage, payload) for payload in sent]
    assert [(m.seq, m.person) for m in messages] == [(0, "1"), (1, "2")]
    assert messages[0].captured_ns == messages[1].captured_ns


def test_lines_of_another_program_may_hold_several_people_in_any_order():
    parts = of_people(("head", "left_hand", "right_hand"), 2)
    tracker = ForeignPeople(parts, 2)
    names = ("head", "left_hand", "right_hand")
    shape = np.array([[0, -50], [-30, 50], [30, 50]])
    for n in range(6):
        places = (100 + n, 400 - n)
        order = places if n % 2 else places[::-1]
        line = {
            name + mark: [*(shape[row] + [u, 200]).tolist(), 0.9]
            for u, mark in zip(order, ("", "@2"), strict=True)
            for row, name in enumerate(names)
        }
        frame = frame_of_line(str({"parts": line}).replace("'", '"').encode(), parts, (n + 1) * SECOND_NS // 15)
        persons = tracker.update(frame).persons
        ids = {round(p.u): p.id for p in persons}
        assert len(ids) == 2 and ids[places[0]] != ids[places[1]]
        first = ids if n == 0 else first  # noqa: F821 - set in the first round
        assert {ids[places[0]], ids[places[1]]} == set(first.values())
    assert project(CAMERA.matrix, person(0, 0)).shape == (15, 2)


@pytest.mark.parametrize(
    ("most", "observers", "view", "followed"),
    [(1, 1, CAMERA, 1), (2, 3, CAMERA, 2), (2, 1, View("camera", THIS_CAMERA_MATRIX), 2),
     (2, 2, View("camera", THIS_CAMERA_MATRIX), 1)],
)  # fmt: skip
def test_a_camera_follows_several_if_it_can_be_known_who_is_who(most, observers, view, followed):
    assert people_followed(most, observers, view) == followed
    note = follows_one(most, observers, view, followed)
    assert bool(note) == (followed < most) and (not note or "calibrate this camera" in note)
    assert "mediapipe" in follows_one(2, 1, view, 1)
