"""Who is who among cameras: matchings against an oracle, people who come, cross, are hidden and leave."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from common import SECOND_NS
from common.floor_place import FloorPlace, best_matching
from fusion.people import BEGIN_S, GONE_S, ScenePeople, SeenTrack

HZ = 15
ROUND = (0.04, 0.0, 0.04)
DEEP = (0.02, 0.0, 0.6)
"""Covariances: of a camera that sees the floor, and of one that hardly knows how far away people are."""
costs = st.lists(st.floats(0, 9), min_size=16, max_size=16).map(lambda each: np.reshape(each, (4, 4)))


@given(costs, st.integers(0, 4), st.integers(1, 4), st.floats(0, 9))
def test_the_matching_is_that_of_the_hungarian_method(table, rows, columns, alone):
    table = table[:rows, :columns]
    total, matching = best_matching(table.tolist(), alone)
    # A row without a column has a column of its own that costs `alone`.
    padded = np.concatenate([table, np.full((rows, rows), alone)], axis=1)
    assert total == pytest.approx(padded[linear_sum_assignment(padded)].sum())
    assert len(set(matching.values())) == len(matching)
    kept = sum(table[row, column] for row, column in matching.items())
    assert total == pytest.approx(kept + alone * (rows - len(matching)))


class Room:
    """Cameras that see people at given places; a track's id is the camera's own."""

    def __init__(self, ids=("1", "2"), cameras=("a", "b"), spread=ROUND, noise=0.0, seed=0):
        self.people, self.cameras, self.spread = ScenePeople(ids), cameras, spread
        self.n, self.noise, self.rng = 1000 * HZ, noise, np.random.default_rng(seed)
        self.tracks = {}

    @property
    def now_ns(self):
        return round(self.n * SECOND_NS / HZ)

    def see(self, places, but=()):
        """One picture of each camera; places: by a name of the test's. but: (camera, name) not seen."""
        seen = []
        for camera, (name, at) in itertools.product(self.cameras, places.items()):
            if (camera, name) not in but:
                track = self.tracks.setdefault((camera, name), f"{len(self.tracks)}")
                at = tuple(float(x) for x in self.rng.normal(at, self.noise))
                seen.append(SeenTrack(camera, track, FloorPlace(at=at, covariance=self.spread), self.now_ns))
        self.people.update(seen, self.now_ns)
        self.n += 1

    def stand(self, places, seconds, but=()):
        for _ in range(round(seconds * HZ)):
            self.see(places, but)

    def who(self, camera, name):
        return self.people.person_of(camera, self.tracks[camera, name])

    def ids(self, name):
        return {self.who(camera, name) for camera in self.cameras}

    def cross(self, but=(), seconds=2.0, aside=0.3, new_tracks=False):
        """A and B change places, and pass each other at a distance."""
        steps = round(seconds * HZ)
        for n in range(steps):
            x = math.cos(math.pi * n / steps)
            z = aside * math.sin(math.pi * n / steps)
            near = abs(x) < 0.4
            if new_tracks and n == steps // 2:
                self.renew("AB")
            self.see({"A": (x, z), "B": (-x, -z)}, but if near else ())

    def renew(self, names):
        """The cameras are not sure who is who, and give new ids."""
        for camera, name in itertools.product(self.cameras, names):
            self.tracks[camera, name] = f"new{camera}{name}"


def test_two_people_seen_by_two_cameras_are_two_in_the_order_from_left_to_right():
    room = Room()
    room.stand({"A": (-0.5, 0), "B": (0.5, 0)}, 1)
    assert room.people.present == ["1", "2"] and room.ids("A") == {"2"} and room.ids("B") == {"1"}
    assert room.people.place("1", room.now_ns) == pytest.approx((0.5, 0), abs=0.05)


@pytest.mark.parametrize("apart", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("spread", [ROUND, DEEP])
def test_noise_makes_nobody_new_and_exchanges_nobody(apart, spread):
    room = Room(noise=0.1, spread=spread)
    places = {"A": (-apart / 2, 0), "B": (apart / 2, 0)}
    room.stand(places, 2)
    before = room.ids("A"), room.ids("B")
    room.stand(places, 20)
    assert len(before[0] | before[1]) == 2 and (room.ids("A"), room.ids("B")) == before


@pytest.mark.parametrize("new_tracks", [False, True])
@pytest.mark.parametrize("cameras", ["a", "ab", "abcd"])
@pytest.mark.parametrize("seed", range(5))
def test_people_who_cross_are_not_exchanged(cameras, new_tracks, seed):
    room = Room(cameras=tuple(cameras), noise=0.05, seed=seed)
    room.stand({"A": (1, 0), "B": (-1, 0)}, 1)
    before = room.ids("A"), room.ids("B")
    assert len(before[0]) == len(before[1]) == 1
    room.cross(new_tracks=new_tracks)
    room.stand({"A": (-1, 0), "B": (1, 0)}, 1.5)
    assert (room.ids("A"), room.ids("B")) == before


def test_a_camera_that_exchanges_its_tracks_is_put_right_by_the_others():
    room = Room(cameras=("a", "b", "c"))
    room.stand({"A": (1, 0), "B": (-1, 0)}, 1)
    tracks = room.tracks
    tracks["a", "A"], tracks["a", "B"] = tracks["a", "B"], tracks["a", "A"]
    room.stand({"A": (1, 0), "B": (-1, 0)}, 2)
    assert room.ids("A") == {"1"} and room.ids("B") == {"2"}


def test_who_is_hidden_for_a_second_comes_back_as_the_same():
    room = Room()
    places = {"A": (1, 0), "B": (-1, 0)}
    room.stand(places, 1)
    room.stand(places, 1, but=[("a", "A"), ("b", "A")])
    assert room.people.present == ["1", "2"]
    room.renew("A")
    room.stand(places, 1)
    assert room.ids("A") == {"1"} and room.ids("B") == {"2"}


def test_who_leaves_is_gone_and_the_next_who_comes_has_the_free_id():
    room = Room()
    room.stand({"A": (1, 0), "B": (-1, 0)}, 1)
    room.stand({"B": (-1, 0)}, GONE_S + 0.2)
    assert room.people.present == ["2"] and room.people.place("1", room.now_ns) is None
    room.stand({"B": (-1, 0), "C": (2, 1)}, BEGIN_S + 1)
    assert room.ids("C") == {"1"} and room.ids("B") == {"2"}


def test_a_third_person_has_no_id_in_a_scene_of_two():
    room = Room()
    room.stand({"A": (2, 0), "B": (0, 0), "C": (-2, 0)}, 2)
    assert room.ids("C") == {None} and room.ids("A") == {"1"} and room.ids("B") == {"2"}


def test_a_camera_that_invents_people_keeps_nobody_out():
    room = Room(cameras=("a", "b", "liar"))
    honest = [("liar", "A"), ("liar", "B")]
    ghost = [("a", "ghost"), ("b", "ghost")]
    room.stand({"A": (1, 0), "ghost": (0, 3)}, 1, but=[*honest, *ghost])
    assert room.who("liar", "ghost") == "2"
    room.stand({"A": (1, 0), "B": (-1, 0), "ghost": (0, 3)}, 2, but=[*honest, *ghost])
    assert room.who("a", "A") == "1" and room.who("a", "B") == room.who("b", "B") == "2"
    assert room.who("liar", "ghost") is None


def test_who_come_together_are_named_from_left_to_right_whoever_is_reported_first():
    """A camera sends a message for each person, and its first pictures may be far apart: its pose model warms up."""
    people, places = ScenePeople(("left", "right")), {"seen_first": -1.0, "seen_next": 1.0}
    for at_s in (0.0, 1.5, 1.6, 1.7):
        for track, x in places.items():
            at_ns = round((1000 + at_s) * SECOND_NS)
            people.update([SeenTrack("a", track, FloorPlace(at=(x, 0.0), covariance=ROUND), at_ns)], at_ns)
    assert [people.person_of("a", track) for track in places] == ["right", "left"]


def test_a_glimpse_begins_nobody():
    room = Room()
    room.stand({"A": (1, 0)}, 1)
    room.stand({"A": (1, 0), "ghost": (-2, 0)}, BEGIN_S / 2)
    room.stand({"A": (1, 0)}, 1)
    assert room.people.present == ["1"]


@pytest.mark.parametrize("camera", ["a", "b"])
def test_a_camera_that_falls_silent_as_somebody_begins_makes_no_second_person(camera):
    """Its track has not been compared with the person whom the track of the other camera began."""
    room = Room()
    while not room.people.present:
        room.see({"A": (1, 0)})
    room.see({"A": (1, 0)}, but={(camera, "A")})
    assert room.people.present == ["1"]
    room.stand({"A": (1, 0)}, 1)
    assert room.people.present == ["1"] and room.ids("A") == {"1"}


def test_a_service_that_follows_another_calls_people_as_that_one_does():
    room = Room()
    room.stand({"A": (1, 0), "B": (-1, 0)}, 1)
    room.people.align({"2": (0.9, 0.1), "1": (-1.1, 0)}, room.now_ns)
    assert room.ids("A") == {"2"} and room.ids("B") == {"1"}
    room.stand({"A": (1, 0), "B": (-1, 0)}, 1)
    assert room.ids("A") == {"2"} and room.ids("B") == {"1"}


def test_a_service_that_begins_expects_people_where_the_last_one_had_them():
    room = Room()
    room.people.align({"2": (1, 0)}, room.now_ns)
    room.stand({"A": (1.1, 0)}, 1)
    assert room.people.present == ["2"] and room.ids("A") == {"2"}


@given(st.lists(st.tuples(st.sampled_from("ab"), st.integers(0, 5), st.floats(-3, 3), st.floats(-3, 3),
                          st.integers(-3000, 3000)), max_size=60))  # fmt: skip
def test_whatever_cameras_say_tracks_of_one_are_of_different_people(sightings):
    people, now_ns = ScenePeople(("1", "2")), 10**6 * SECOND_NS
    for n, (camera, track, x, z, late_ms) in enumerate(sightings):
        at_ns = now_ns + n * SECOND_NS // 10 + late_ms * 10**6
        place = FloorPlace(at=(x, z), covariance=ROUND)
        people.update([SeenTrack(camera, str(track), place, at_ns)], now_ns + n * SECOND_NS // 10)
        assert set(people.present) <= {"1", "2"}
        for each in people.present:
            assert all(map(math.isfinite, people.place(each, now_ns + n * SECOND_NS // 10)))
