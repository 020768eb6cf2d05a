"""After a split network has healed each listener has one id for each movement, and its end."""

from dataclasses import dataclass

import pytest

from hub.same_movement import LIMIT, SameMovement


@dataclass(frozen=True)
class Word:
    id: str
    ended_ns: int | None = None
    same_as: str | None = None
    label: str = "bow"

    @property
    def stage(self):
        return "decided" if self.ended_ns is None else "ended"


DECIDED, ENDED, CLOSED = Word("left"), Word("left", 9), Word("left", 8, "right")
OTHER = [Word("right"), Word("right", 9)]
CASES = {
    "no split": ([DECIDED, ENDED, *OTHER], [DECIDED, ENDED, *OTHER]),
    "of the half that stood down": ([DECIDED, CLOSED, *OTHER], [DECIDED, CLOSED]),
    "of the other half": ([OTHER[0], CLOSED, OTHER[1]], OTHER),
    "of the other half, where it was over": ([*OTHER, Word("left", 8, "")], OTHER),
    "that heard both": ([DECIDED, OTHER[0], CLOSED, OTHER[1]], [DECIDED, OTHER[0], CLOSED, OTHER[1]]),
    "that hears the same of two services": ([DECIDED, DECIDED, ENDED, ENDED], [DECIDED, ENDED]),
    "that knows the end": ([DECIDED, ENDED, CLOSED], [DECIDED, ENDED]),
}


@pytest.mark.parametrize(("words", "taken"), CASES.values(), ids=CASES)
def test_a_listener(words, taken):
    same = SameMovement()
    assert [word for word in words if same.passes(word)] == taken


def test_it_forgets_the_oldest():
    same = SameMovement()
    for n in range(2 * LIMIT):
        assert same.passes(Word(f"dojo-{n}"))
    assert not same.passes(Word("dojo-0", 8, "")) and same.passes(Word(f"dojo-{2 * LIMIT - 1}", 8, ""))
