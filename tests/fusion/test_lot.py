"""Of a flood only the newest of each observer are read; of a calm lot everything."""

from hypothesis import given
from hypothesis import strategies as st

from common.inbox import Arrival
from fusion.lot import CALM, NEWEST, newest

keys = st.lists(st.sampled_from(["cam1", "cam2", "cam3"]), max_size=40)


def lot(names):
    return [Arrival(name, bytes([n]), n) for n, name in enumerate(names)]


@given(keys)
def test_a_calm_lot_is_read_whole(names):
    assert newest(lot(names), CALM) == lot(names)


@given(keys)
def test_of_a_flood_the_last_of_each_are_read_in_their_order(names):
    arrivals = lot(names)
    expected = [a for n, a in enumerate(arrivals) if names[n + 1 :].count(a.key) < NEWEST]
    assert newest(arrivals, 0) == (expected if len(names) > NEWEST else arrivals)


def test_one_who_floods_takes_nothing_from_the_others():
    names = ["cam1"] * CALM + ["cam2"] + ["cam1"] * CALM
    assert [a.key for a in newest(lot(names))].count("cam2") == 1
    assert len(newest(lot(names))) == 1 + NEWEST
