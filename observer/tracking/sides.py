"""Which hand a newly found hand is: decided once at acquisition, kept by the filters afterwards."""

from collections.abc import Sequence

from observer.tracks import Floats

LEFT, RIGHT, HEAD = 0, 1, 2
"""Rows of the parts, in the order of `observer.tracks.BODY_PARTS`."""


def name_two(found: Sequence[Floats]) -> dict[int, int]:
    """Two new hands, centres (2,) px: row -> index into `found`. The hand on the picture's left is the right hand."""
    right = int(found[1][0] < found[0][0])
    return {RIGHT: right, LEFT: 1 - right}


def name_first(found: Floats, head: Floats, margin: float) -> int | None:
    """One new hand and none known: the row of the head's side; None within `margin` px of the head's middle."""
    away = float(found[0] - head[0])
    if abs(away) < margin:
        return None
    return RIGHT if away < 0 else LEFT


def name_second(found: Floats, known: Floats, row: int, head: Floats, margin: float) -> tuple[bool, bool]:
    """One new hand while the hand of `row` is known at `known` (2,) px: (believe it, exchange the two names).

    It is believed on its own side of the other hand or of the head. If both are on each other's side of the head by
    more than `margin` px, the known hand took the lost one's name in a crossing: they are exchanged.
    """
    outwards = -1.0 if row == LEFT else 1.0  # where the missing hand belongs
    new, old = outwards * float(found[0] - head[0]), outwards * float(known[0] - head[0])
    if new < -margin and old > margin:
        return True, True
    return new > old or new > margin, False


AMBIGUOUS = 6.0
"""Hands that the other one's filter would have expected almost as much (difference of squared distances)."""
APART = (0.6, 2.0)
"""How far apart sideways hands must be to say which is which, and from where on they say no more: face widths."""
SURE, NAMED, ENOUGH = 3.0, 0.25, 0.08
"""Evidence for the names, face widths apart times seconds: the most there is, of hands just named, what decides."""


class HandednessEvidence:
    """Whether the names of the two hands are in doubt, and when to exchange them.

    Filters carry the names through a crossing. Where two hands meet and part, crossing and turning back look alike;
    then the person's build decides: the left hand is seldom for long on the right one's side of it.
    """

    def __init__(self) -> None:
        self._evidence = NAMED

    @property
    def doubtful(self) -> bool:
        """Whether the hands may as well have each other's name."""
        return self._evidence < ENOUGH

    def heard(self, cost: Floats, chosen: Sequence[int | None]) -> None:
        """cost: (2, N) squared distances from LEFT and RIGHT; chosen: the column of each, or None."""
        left, right = chosen
        worse = [cost[1 - row, column] - cost[row, column] for row, column in enumerate(chosen) if column is not None]
        both = left is not None and right is not None
        # Names of two measured hands are exchanged together or not at all.
        if worse and (sum(worse) if both else min(worse)) < AMBIGUOUS:
            self._evidence = min(self._evidence, 0.0)

    def merged(self) -> None:
        """The hands were one piece of skin: whether they passed each other was not seen."""
        self._evidence = min(self._evidence, 0.0)

    def exchange(self, left: Floats, right: Floats, face: float, seconds: float) -> bool:
        """Whether to exchange the names of two seen hands, centres (2,) px, after `seconds` more; face: width, px."""
        apart = float(left[0] - right[0]) / face
        if abs(apart) > APART[0]:
            self._evidence = min(self._evidence + min(max(apart, -APART[1]), APART[1]) * seconds, SURE)
        if self._evidence > -ENOUGH:
            return False
        self._evidence = ENOUGH
        return True

    def forget(self) -> None:
        """A hand was found anew and named."""
        self._evidence = NAMED
