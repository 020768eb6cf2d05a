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
"""A hand that the other one's filter would have expected almost as much (difference of squared distances)."""
FRAMES = 3
"""Hands on each other's side for so many frames running, while their names are in doubt, are exchanged."""


class Doubt:
    """Whether the names of the two hands are in doubt, and when to exchange them.

    Filters carry the names through a crossing. Where two hands meet and part, crossing and turning back look alike;
    then the person's build decides: an arm seldom reaches beyond the other side of the head while the other does too.
    """

    def __init__(self) -> None:
        self.doubtful, self._crossed = False, 0

    def heard(self, cost: Floats, chosen: Sequence[int | None]) -> None:
        """cost: (2, N) squared distances from LEFT and RIGHT; chosen: the column of each, or None."""
        for row, column in enumerate(chosen):
            if column is not None and cost[1 - row, column] - cost[row, column] < AMBIGUOUS:
                self.doubtful = True

    def exchange(self, left: Floats, right: Floats, head: Floats, margin: float) -> bool:
        """Whether to exchange the names of two seen hands, centres (2,) px, now; `margin` px from the head's middle."""
        apart = float(left[0] - right[0])
        if apart > 0.6 * margin:
            self.doubtful, self._crossed = False, 0
        crossed = self.doubtful and left[0] < head[0] - margin and right[0] > head[0] + margin
        self._crossed = self._crossed + 1 if crossed else 0
        if self._crossed < FRAMES:
            return False
        self.doubtful, self._crossed = False, 0
        return True

    def forget(self) -> None:
        """A hand was found anew and named: no doubt is left."""
        self.doubtful, self._crossed = False, 0
