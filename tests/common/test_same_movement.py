"""Each listener has one id for each movement, and its end, also where two services judged the movement."""

from dataclasses import dataclass, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.same_movement import LIMIT, SameMovement, is_same_movement


@dataclass(frozen=True)
class Word:
    """What counts of a verdict; times in tenths of a second."""

    id: str
    ended_ns: int | None = None
    same_as: str | None = None
    label: str = "bow"
    began_ns: int = 0
    at_ns: int = 2
    revises: str | None = None
    session: str = "a"
    person: str | None = None

    @property
    def fusion(self):
        return self.id

    @property
    def stage(self):
        if self.ended_ns is not None:
            return "ended"
        return "decided" if self.revises is None else "revised"

    def model_copy(self, update):
        return replace(self, **update)


@dataclass(frozen=True)
class Movement:
    id: str

    def model_copy(self, update):
        return replace(self, **update)


@dataclass(frozen=True)
class Judged:
    movement: Movement | None
    at_ns: int

    def model_copy(self, update):
        return replace(self, **update)


DECIDED, ENDED, CLOSED = Word("left"), Word("left", 9), Word("left", 8, "right")
LATER = [Word("right", began_ns=20, at_ns=22), Word("right", 29, began_ns=20, at_ns=30)]
LUNGE = [Word("right", label="lunge"), Word("right", 9, label="lunge")]
SAME = [Word("right"), Word("right", 9)]
NEXT = Word("next", 18, began_ns=9)
CASES = {
    "no split": ([DECIDED, ENDED, *LATER], [DECIDED, ENDED, *LATER]),
    "of the half that stood down": ([DECIDED, CLOSED, *LUNGE], [DECIDED, CLOSED]),
    "of the other half": ([SAME[0], CLOSED, SAME[1]], SAME),
    "of the other half, where it was over": ([*SAME, Word("left", 8, "")], SAME),
    "that heard both, of two labels": ([DECIDED, LUNGE[0], CLOSED, LUNGE[1]], [DECIDED, LUNGE[0], CLOSED, LUNGE[1]]),
    "that heard both": ([DECIDED, SAME[0], ENDED, SAME[1]], [DECIDED, ENDED]),
    "that heard both, one closed": ([DECIDED, SAME[0], CLOSED, SAME[1]], [DECIDED, CLOSED]),
    "that heard both, and the end of the second": ([DECIDED, *SAME], [DECIDED, ENDED]),
    "that heard one after the other": ([DECIDED, ENDED, *SAME], [DECIDED, ENDED]),
    "with another opinion in the second": (
        [DECIDED, SAME[0], Word("right", label="lunge", revises="bow"), Word("right", 9, label="lunge"), ENDED],
        [DECIDED, ENDED],
    ),
    "that hears the same of two services": ([DECIDED, DECIDED, ENDED, ENDED], [DECIDED, ENDED]),
    "that hears what came before the end again": ([DECIDED, ENDED, DECIDED], [DECIDED, ENDED]),
    "that knows the end": ([DECIDED, ENDED, CLOSED], [DECIDED, ENDED]),
    "of movements that touch": ([DECIDED, ENDED, NEXT], [DECIDED, ENDED, NEXT]),
}  # fmt: skip


@pytest.mark.parametrize(("words", "taken"), CASES.values(), ids=CASES)
def test_a_listener(words, taken):
    same = SameMovement()
    assert [word for word in map(same.take, words) if word is not None] == taken


def test_while_judgements_show_a_movement_it_goes_on():
    late = Word("right", began_ns=30, at_ns=40)
    for shown, is_taken in ((5, True), (40, False)):
        same = SameMovement()
        same.take(DECIDED)
        assert same.judged(Judged(Movement("left"), shown)).movement.id == "left"
        assert (same.take(late) is not None) == is_taken
    assert same.judged(Judged(Movement("right"), 50)).movement.id == "left"
    assert same.judged(Judged(None, 50)).movement is None


def test_a_service_gives_each_movement_one_id():
    @dataclass(frozen=True)
    class Own(Word):
        fusion: str = "one"

    for session, is_taken in (("a", True), ("b", False)):
        same = SameMovement()
        assert same.take(Own("first")) is not None
        assert (same.take(Own("second", session=session)) is not None) == is_taken


def test_it_forgets_the_oldest():
    same = SameMovement()
    for n in range(2 * LIMIT):
        assert same.take(Word(f"dojo-{n}", began_ns=10 * n, at_ns=10 * n + 5))
    assert same.take(Word("dojo-0", 8, "")) is None and same.take(Word(f"dojo-{2 * LIMIT - 1}", 8, "")) is not None


SPANS = st.tuples(st.integers(0, 1000), st.integers(0, 1000)).map(lambda ends: (min(ends), max(ends)))


@given(SPANS, SPANS)
def test_one_movement_is_what_overlaps_by_half_of_the_shorter(one, other):
    shared = len(set(range(*one)) & set(range(*other)))
    shorter = min(one[1] - one[0], other[1] - other[0])
    if shorter:
        assert is_same_movement("bow", one, "bow", other) == (2 * shared >= shorter)
    assert is_same_movement("bow", one, "bow", other) == is_same_movement("bow", other, "bow", one)
    assert not is_same_movement("bow", one, "lunge", other) and is_same_movement("bow", one, "bow", one)
