"""Several people from picture to picture: ids that live, and new ones where two may have been exchanged."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common import SECOND_NS
from observer.tracking.people import OTHER_S
from observer.tracking.person_keeper import Detection, PersonKeeper

HZ, HEIGHT = 15, 300.0
SHAPE = {
    "A": np.random.default_rng(1).uniform(-120, 120, (8, 2)),
    "B": np.random.default_rng(2).uniform(-120, 120, (8, 2)),
}


def body(name, u, v=240.0, height=HEIGHT):
    return Detection(SHAPE[name] + [u, v], u, v, height)


class Film:
    """Pictures at HZ."""

    def __init__(self, most=2):
        self.keeper, self.n = PersonKeeper(most), 0

    def show(self, *bodies):
        """The people in one more picture: id -> u of those who are seen, None of those who are remembered."""
        self.n += 1
        persons = self.keeper.update(bodies, round(self.n * SECOND_NS / HZ))
        return {p.id: round(p.u) if np.isfinite(p.centres).all() else None for p in persons}


@given(st.permutations([0, 1]), st.integers(0, 3))
def test_the_order_of_detections_does_not_matter(order, jitter):
    film = Film()
    for n in range(10):
        bodies = [body("A", 200 + n), body("B", 400 - n)]
        shown = film.show(*(bodies[i] for i in (order if n % (jitter + 1) else (0, 1))))
    assert sorted(shown) == [1, 2]


def test_two_who_pass_each_other_and_are_both_seen_keep_their_ids():
    film = Film()
    first = film.show(body("A", 100), body("B", 500))
    for step in range(41):
        shown = film.show(body("B", 500 - 10 * step), body("A", 100 + 10 * step))
    ids = {u: n for n, u in first.items()}
    assert shown == {ids[100]: 500, ids[500]: 100}


def test_who_is_covered_in_passing_keeps_the_id_and_so_does_who_covers():
    film = Film()
    film.show(body("A", 100), body("B", 500))
    for step in range(41):
        u, w = 100 + 10 * step, 500 - 10 * step
        seen = [body("A", u)] if abs(u - w) < 90 else [body("A", u), body("B", w)]
        shown = film.show(*seen)
    assert shown == {1: 500, 2: 100}


def test_a_body_that_jumps_near_another_may_be_the_other_and_gets_a_new_id():
    film = Film()
    for _ in range(5):
        film.show(body("A", 200), body("B", 290))
    # The model takes one for the other, and finds one body of the two.
    shown = film.show(body("A", 260))
    assert shown == {}
    assert film.show(body("A", 150), body("B", 350)).keys() == {3, 4}


def test_who_stands_still_keeps_the_id_when_somebody_appears_beside_them():
    """The one who was hidden is not taken for the one who stands: both would have had to leap."""
    film = Film()
    for _ in range(5):
        ids = film.show(body("A", 400), body("A", 200))
    for _ in range(4):
        film.show(body("A", 400))
    shown = film.show(body("A", 402), body("A", 480))
    assert shown[next(n for n, u in ids.items() if u == 400)] == 402


def test_who_is_not_seen_is_remembered_for_a_while():
    film = Film()
    film.show(body("A", 100), body("B", 500))
    assert film.show(body("A", 100)) == {1: 100, 2: None}
    for _ in range(round(OTHER_S * HZ) + 1):
        shown = film.show(body("A", 100))
    assert shown == {1: 100}
    assert film.show(body("A", 100), body("B", 500)) == {1: 100, 3: 500}


def test_no_more_are_followed_than_wanted_and_the_tallest_first():
    film = Film(most=1)
    assert film.show(body("A", 100, height=200.0), body("B", 500)) == {1: 500}


@pytest.mark.parametrize("seconds", [2.0, -1.0])
def test_after_a_gap_or_a_clock_set_back_everybody_is_new(seconds):
    film = Film()
    film.show(body("A", 100))
    film.n += round(seconds * HZ)
    assert film.show(body("A", 100)).keys() == {2}
