"""The segment since the begin of a movement: known after rest, unknown once another motion follows the movement. And
what was believed before it, which stands in rest as far as the segment is no movement."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.model.movement_segment import MovementBefore, MovementSegment
from observer.tracks import Floats

RATE_HZ = 30.0
FRAMES = {"R": (True, 1.0), "M": (False, 0.05), "O": (False, 0.95)}
"""Rest, movement, something else: whether the person rests, and P(something else)."""


def answers(something_else: float, movement: int = 0) -> Floats:
    """(4,) probabilities of three movements and something else."""
    return np.array([*((1 - something_else) * (m == movement) for m in range(3)), something_else])


def shown(stream: str) -> list[int | None]:
    """The frames since the begin, after each frame of a stream such as `R30 M20`."""
    segment = MovementSegment(RATE_HZ, False, 90.0)
    begun, frames = list[int | None](), (FRAMES[part[0]] for part in stream.split() for _ in range(int(part[1:])))
    for stored, (resting, something_else) in enumerate(frames, 1):
        segment.update(resting, 1.0 * resting, answers(something_else), something_else, stored)
        begun.append(segment.begun)
    return begun


STREAMS = {
    "after rest: the lag of stillness, and the frames since rest ended": ("R30 O8 M22", 9 + 29),
    "the next one without rest": ("R30 M20 O10 M20", None),
    "rest before the third one shows its begin": ("R30 M20 O10 M20 R15 M10", 9 + 9),
    "the stream begins in it": ("M20", 20),
    "the stream begins in another one": ("M20 R15 M10", 9 + 9),
}


@pytest.mark.parametrize(("stream", "begun"), STREAMS.values(), ids=STREAMS)
def test_a_movement_has_a_begin_after_rest_and_the_next_one_without_rest_has_none(
    stream: str, begun: int | None
) -> None:
    assert shown(stream)[-1] == begun


@pytest.mark.parametrize(
    "stream",
    ["R30 M20 O10 R5", "R30 M20 O9 M5", "R30 O30 M10"],
    ids=["something else rises before rest is seen", "a moment of doubt", "a slow begin is like something else"],
)
def test_what_is_no_next_movement_does_not_end_the_segment(stream: str) -> None:
    assert None not in shown(stream)[30:]


def test_a_segment_in_which_two_movements_are_named_has_no_begin() -> None:
    for onset_known in (False, True):
        segment = MovementSegment(RATE_HZ, onset_known, 90.0)
        begun = []
        for stored in range(1, 31):
            segment.update(False, 0.0, answers(0.1, 1 if stored <= 20 else 2), 0.1, stored)
            begun.append(segment.begun)
        if onset_known:
            assert begun == [*range(1, 31)], "a known onset is that of one movement, whatever it is taken for"
        else:
            assert begun == [*range(1, 30), None], "the second one is named after 0.3 s"


def test_a_change_of_mind_that_is_not_sure_ends_nothing() -> None:
    segment = MovementSegment(RATE_HZ, False, 90.0)
    for stored in range(1, 41):
        segment.update(False, 0.0, answers(0.25 if stored <= 20 else 0.1, stored // 20), 0.1, stored)
    assert segment.begun == 40


def test_a_posture_that_is_held_ends_the_segment_and_one_that_is_not_goes_on() -> None:
    """Somebody who bends down and stays so does not rest, and the movement has ended."""
    rows = np.arange(200.0, dtype=np.float32)[:, None]
    segment, held, moving = MovementSegment(RATE_HZ, True, 90.0), (False, 0.9), (False, 0.0)
    for stored, (resting, still) in enumerate([*[moving] * 20, *[held] * 30], 1):
        segment.update(resting, still, answers(0.05), 0.05, stored)
    assert segment.over and segment.begun is not None and segment.begun < 20 + 5
    assert segment.rows_of(rows[:50])[:, 0].tolist() == [*range(segment.begun)]
    for stored in range(51, 56):
        segment.update(False, 0.0, answers(0.05), 0.05, stored)
    assert (segment.over, segment.begun, segment.number) == (False, 55, 0), "the pause is part of the movement"


def test_who_is_still_has_not_ended_their_rest() -> None:
    """The windows that trail may take a posture for one in a movement."""
    segment = MovementSegment(RATE_HZ, True, 90.0)
    frames = [*[(False, 0.0)] * 20, *[(True, 0.9)] * 20, *[(False, 0.9)] * 5, *[(True, 0.9)] * 5]
    for stored, (resting, still) in enumerate(frames, 1):
        segment.update(resting, still, answers(0.5), 0.5, stored)
    assert (segment.over, segment.begun, segment.number) == (True, 20, 0)


@given(st.lists(st.tuples(st.booleans(), st.floats(0, 1), st.floats(0, 1)), max_size=120))
def test_the_segment_is_never_longer_than_what_is_stored(frames: list[tuple[bool, float, float]]) -> None:
    rows = np.arange(200.0, dtype=np.float32)[:, None]
    segment = MovementSegment(RATE_HZ, False, 40.0)
    for stored, (resting, still, something_else) in enumerate(frames, 1):
        segment.update(resting and still >= 0.5, still, answers(something_else), something_else, stored)
        own = segment.rows_of(rows[:stored])
        assert len(own) == (segment.begun or 0)
        assert segment.begun is None or segment.begun <= 40
        end = stored - segment.ended
        assert own[:, 0].tolist() == [*range(end - len(own), end)]


SHARES = st.floats(0, 1)
ANSWERS = st.lists(st.floats(0.01, 1), min_size=3, max_size=3).map(lambda p: np.array(p) / sum(p))


@given(ANSWERS, st.lists(st.tuples(ANSWERS, SHARES, SHARES), min_size=1, max_size=5))
def test_in_rest_the_belief_before_the_segment_stands_as_far_as_it_is_no_movement(
    earlier: Floats, instants: list[tuple[Floats, float, float]]
) -> None:
    before = MovementBefore()
    for p, something_else, rest in instants:
        assert before.mixed(p, something_else, rest) is p, "before the first one there is nothing"
    before.begin(earlier)
    for n, (p, something_else, rest) in enumerate(instants, 1):
        mixed = before.mixed(p, something_else, rest)
        nothing = min(e for _, e, _ in instants[:n])
        weights = np.array([1 - nothing, nothing * rest])
        expected = weights @ np.array([p, earlier]) / weights.sum() if weights.sum() > 0 else p
        np.testing.assert_allclose(mixed, expected, atol=1e-12)
        assert mixed.sum() <= 1 + 1e-12
