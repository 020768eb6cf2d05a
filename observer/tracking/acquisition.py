"""New hands: acceptance of moving or resting skin, and which hand is the left one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.tracking.back_projection import SkinPatch
from observer.tracks import Floats

FRAMES, PRESENT_S = 3, 0.13
"""A candidate is accepted after this many frames in a row, or after two that are as far apart as three of 15 Hz."""
LEAP, SPEED = 1.2, 18.0
"""Farthest that a candidate may move between two frames, face widths; in frames that are rare, face widths per s: as
far as that at 15 Hz, some 2.7 m/s."""
MOVED_SHARE = 0.3
"""Least share of a candidate's pixels that moved, in each of its frames: a lamp or a cupboard does not move."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A patch, and for how many frames in a row, and seconds, it was present."""

    patch: SkinPatch
    frames: int = 1
    seconds: float = 0.0

    @property
    def is_lasting(self) -> bool:
        """Whether it was present for long enough to be a hand."""
        return self.frames >= FRAMES or (self.frames > 1 and self.seconds >= PRESENT_S)


class HandAcquisition:
    """Remembers candidates from frame to frame."""

    def __init__(self) -> None:
        self._candidates: list[Candidate] = []

    def update(self, patches: Sequence[SkinPatch], face: float, seconds: float) -> list[SkinPatch]:
        """Patches that may be hands -> the accepted ones, best first.

        face: face width, px. seconds: since the frame before.
        """
        candidates, reach = [], max(LEAP, SPEED * seconds) * face
        previous = list(self._candidates)
        for patch in patches:
            if patch.moved < MOVED_SHARE:
                continue
            near = [c for c in previous if _distance(c.patch.centre, patch.centre) < reach]
            candidate = Candidate(patch)
            if near:
                nearest = min(near, key=lambda c: _distance(c.patch.centre, patch.centre))
                previous = [c for c in previous if c is not nearest]
                candidate = Candidate(patch, nearest.frames + 1, nearest.seconds + seconds)
            candidates.append(candidate)
        self._candidates = candidates
        best_first = sorted(candidates, key=lambda c: (-c.frames, -c.patch.area))
        return [c.patch for c in best_first if c.is_lasting]

    def forget(self) -> None:
        """Drop all candidates."""
        self._candidates = []


HANGING = ((0.6, 2.6), (3.0, 6.5))
"""Where hands hang: distances beside and below the middle of the head, face widths."""
REST_S, TREMBLE = 0.6, 0.3
"""A hanging hand is accepted after this long, if it stays within this many face widths."""


class RestingHands:
    """Finds a hand that does not move: the only skin where a hand hangs, on its side of the body, for a while."""

    def __init__(self) -> None:
        self._candidates: dict[int, tuple[Floats, float]] = {}

    def update(self, pieces: Sequence[SkinPatch], head: Floats, face: float, seconds: float) -> dict[int, SkinPatch]:
        """All skin patches of a frame -> accepted hanging hands, by side: -1 the picture's left, 1 its right."""
        accepted, candidates = {}, {}
        for side in (-1, 1):
            patches = [p for p in pieces if _hangs((p.centre - head) * (side, 1) / face)]
            if len(patches) != 1:
                continue
            centre = patches[0].centre
            start, since_s = self._candidates.get(side, (centre, 0.0))
            stayed = _distance(start, centre) < TREMBLE * face
            candidates[side] = (start, since_s + seconds) if stayed else (centre, 0.0)
            if candidates[side][1] >= REST_S:
                accepted[side] = patches[0]
        self._candidates = candidates
        return accepted


def _hangs(offset: Floats) -> bool:
    (left, right), (top, bottom) = HANGING
    return bool(left < offset[0] < right and top < offset[1] < bottom)


def _distance(one: Floats, other: Floats) -> float:
    return float(np.hypot(*(one - other)))


LEFT, RIGHT, HEAD = 0, 1, 2
"""Rows of the parts, in the order of `observer.tracks.BODY_PARTS`."""


def name_two(centres: Sequence[Floats]) -> dict[int, int]:
    """Two new hands, centres (2,) px: row -> index into `centres`. The hand on the picture's left is the right hand."""
    right = int(centres[1][0] < centres[0][0])
    return {RIGHT: right, LEFT: 1 - right}


def name_first(centre: Floats, head: Floats, margin: float) -> int | None:
    """One new hand while none is tracked: the row of its side of the head; None within `margin` px of the head."""
    offset = float(centre[0] - head[0])
    if abs(offset) < margin:
        return None
    return RIGHT if offset < 0 else LEFT


def name_second(centre: Floats, known: Floats, row: int, head: Floats, margin: float) -> tuple[bool, bool]:
    """One new hand while the hand of `row` is tracked at `known` (2,) px: (accept it, exchange the two names).

    It is accepted on its own side of the other hand or of the head. If both hands are on each other's side of the head
    by more than `margin` px, the tracked hand took the lost hand's name in a crossing, and the names are exchanged.
    """
    outwards = -1.0 if row == LEFT else 1.0  # the side of the missing hand
    new, old = outwards * float(centre[0] - head[0]), outwards * float(known[0] - head[0])
    if new < -margin and old > margin:
        return True, True
    return new > old or new > margin, False


AMBIGUOUS = 6.0
"""Difference of squared distances below which the other hand's filter explains a measurement almost as well."""
SEPARATION = (0.6, 2.0)
"""Horizontal distance of the hands, face widths: less tells nothing about their sides, more counts as this much."""
MOST, INITIAL, DECISIVE = 3.0, 0.25, 0.08
"""Evidence for the names, face widths times seconds: its maximum, its value for new hands, the value that decides."""


class HandednessEvidence:
    """Evidence that the two hands have the right names, and when to exchange them.

    The filters carry the names through a crossing. When two hands meet and part, crossing and turning back look alike;
    then anatomy decides: the left hand is rarely for long on the right hand's right.
    """

    def __init__(self) -> None:
        self._evidence = INITIAL

    @property
    def doubtful(self) -> bool:
        """Whether the names may be exchanged."""
        return self._evidence < DECISIVE

    def add_assignment(self, cost: Floats, columns: Sequence[int | None]) -> None:
        """cost: (2, N) squared distances from LEFT and RIGHT. columns: the measurement assigned to each, or None."""
        left, right = columns
        worse = [cost[1 - row, column] - cost[row, column] for row, column in enumerate(columns) if column is not None]
        both = left is not None and right is not None
        # The names of two measured hands are exchanged together or not at all.
        if worse and (sum(worse) if both else min(worse)) < AMBIGUOUS:
            self._evidence = min(self._evidence, 0.0)

    def add_merge(self) -> None:
        """Note that the hands were one piece of skin: whether they crossed was not visible."""
        self._evidence = min(self._evidence, 0.0)

    def exchange(self, left: Floats, right: Floats, face: float, seconds: float) -> bool:
        """Whether to exchange the names of two seen hands, centres (2,) px, after `seconds` more; face: width, px."""
        separation = float(left[0] - right[0]) / face
        if abs(separation) > SEPARATION[0]:
            step = min(max(separation, -SEPARATION[1]), SEPARATION[1]) * seconds
            self._evidence = min(self._evidence + step, MOST)
        if self._evidence > -DECISIVE:
            return False
        self._evidence = DECISIVE
        return True

    def reset(self) -> None:
        """A hand was acquired and named anew."""
        self._evidence = INITIAL
