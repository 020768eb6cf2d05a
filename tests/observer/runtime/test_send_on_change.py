"""What an observer holds back: never more than the bound, never a change of mind, never for too long."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.runtime.pipeline import Posterior
from observer.runtime.posterior_encoder import BOUND, Gist, SendOnChange, distance

FRAME_NS = 33_333_333
HEARTBEAT_S = 0.1
CHANCES = st.floats(0, 1)


@st.composite
def beliefs(draw, size=4):
    mass = np.array(draw(st.lists(st.floats(0.001, 1), min_size=size, max_size=size)))
    return mass / mass.sum()


@st.composite
def opinions(draw):
    facing = np.array([draw(beliefs(3)) for _ in range(4)]) if draw(st.booleans()) else None
    facets = {"shape_vertical": draw(beliefs(3))} if draw(st.booleans()) else {}
    visible = {"head": draw(st.booleans()), "left_hand": draw(st.booleans())}
    return Posterior(draw(beliefs()), draw(CHANCES), 1, visible, facets, facing, draw(st.none() | CHANCES))


@st.composite
def drifting(draw):
    """Opinions that change little from one to the next, as those of a camera do."""
    ends = draw(st.lists(opinions(), min_size=2, max_size=4))
    alike = [Posterior(o.p, o.rest, 1, ends[0].visible, unlearned=o.unlearned or 0.0) for o in ends]
    steps = np.linspace(0, 1, 12)
    return [
        Posterior(
            (1 - s) * a.p + s * b.p, (1 - s) * a.rest + s * b.rest, 1, a.visible,
            unlearned=(1 - s) * a.unlearned + s * b.unlearned,
        )
        for a, b in pairwise(alike)
        for s in steps
    ]  # fmt: skip


@given(st.lists(opinions(), min_size=1, max_size=20) | drifting(), st.booleans())
def test_what_is_held_back_is_within_the_bound_of_what_was_said_and_on_the_same_side(said, directed):
    restraint, heard, heard_ns = SendOnChange(HEARTBEAT_S, directed), None, 0
    for n, opinion in enumerate(said):
        now_ns = n * FRAME_NS
        if restraint.should_send(opinion, now_ns):
            heard, heard_ns = opinion, now_ns
            continue
        assert heard is not None and now_ns - heard_ns < HEARTBEAT_S * 1e9
        assert np.abs(opinion.p - heard.p).sum() / 2 <= BOUND
        assert abs(opinion.rest - heard.rest) <= BOUND and (opinion.rest >= 0.5) == (heard.rest >= 0.5)
        assert opinion.p.argmax() == heard.p.argmax()
        assert any(opinion.visible.values()) == any(heard.visible.values())
        assert (opinion.unlearned is None) == (heard.unlearned is None)
        if directed and opinion.facing is not None:
            joint = (o.p[:, None] * o.facing for o in (opinion, heard))
            assert np.abs(next(joint) - next(joint)).sum() / 2 <= BOUND
        for name, facet in opinion.facets.items():
            assert np.abs(facet - heard.facets[name]).sum() / 2 <= BOUND


@given(opinions(), st.lists(st.integers(1, 300_000_000), min_size=5, max_size=40))
def test_an_unchanged_opinion_is_said_as_often_as_its_heart_beats(opinion, gaps_ns):
    restraint, times = SendOnChange(HEARTBEAT_S), np.cumsum(gaps_ns).tolist()
    said = [at_ns for at_ns in times if restraint.should_send(opinion, at_ns)]
    assert said[0] == times[0]
    for before, after in pairwise(said):
        assert after - before >= HEARTBEAT_S * 1e9
        # The first frame after the beat is due, and no later one.
        assert not any(before + HEARTBEAT_S * 1e9 <= at_ns < after for at_ns in times)


def opinion(p=(0.5, 0.3, 0.2), rest=0.2, visible=True, **more):
    return Posterior(np.array(p), rest, 1, {"head": visible}, **more)


@pytest.mark.parametrize(
    "changed",
    [
        {"p": (0.399, 0.401, 0.2)}, {"p": (0.485, 0.315, 0.2)}, {"rest": 0.215}, {"visible": False}, {"unlearned": 0.1},
        {"facets": {"effort_time": np.array([0.5, 0.5])}},
    ],
)  # fmt: skip
def test_a_change_is_said_at_once(changed):
    restraint = SendOnChange(HEARTBEAT_S)
    assert restraint.should_send(opinion(), 0)
    assert not restraint.should_send(opinion(p=(0.495, 0.305, 0.2), rest=0.205), 1)
    assert restraint.should_send(opinion(**changed), 2)


@pytest.mark.parametrize(("before", "after"), [((0.401, 0.399, 0.2), (0.399, 0.401, 0.2))])
def test_another_likeliest_movement_is_said_however_little_has_moved(before, after):
    restraint = SendOnChange(HEARTBEAT_S)
    assert [restraint.should_send(opinion(p=p), n) for n, p in enumerate((before, before, after, after))] == [
        1,
        0,
        1,
        0,
    ]


def test_the_side_of_rest_is_said_however_little_has_moved():
    restraint = SendOnChange(HEARTBEAT_S)
    assert [restraint.should_send(opinion(rest=r), n) for n, r in enumerate((0.499, 0.5, 0.501))] == [1, 1, 0]


def test_a_clock_that_is_set_back_silences_nobody():
    restraint = SendOnChange(HEARTBEAT_S)
    assert restraint.should_send(opinion(), 10**18) and restraint.should_send(opinion(), 5)


def test_facing_counts_only_for_who_says_it():
    turned = [np.array([[1.0, 0.0]] * 3), np.array([[0.0, 1.0]] * 3)]
    for directed, far in ((True, 1.0), (False, 0.0)):
        one, other = (Gist.of(opinion(facing=facing), directed) for facing in turned)
        assert distance(one, other) == pytest.approx(far)
