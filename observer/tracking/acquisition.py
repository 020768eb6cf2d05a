"""New hands: a moving piece of skin within reach, present in several frames in a row, or a hand that hangs at rest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.tracking.back_projection import SkinPatch
from observer.tracks import Floats

FRAMES = 3
"""A candidate is accepted after this many frames in a row."""
LEAP = 1.2
"""Farthest distance that a candidate may move between two frames, face widths."""
MOVED = 0.3
"""Least share of a candidate's pixels that moved, in each of its frames: a lamp or a cupboard does not move."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A patch, and for how many frames in a row it was present."""

    patch: SkinPatch
    frames: int


class HandAcquisition:
    """Remembers candidates from frame to frame."""

    def __init__(self) -> None:
        self._candidates: list[Candidate] = []

    def update(self, patches: Sequence[SkinPatch], face: float) -> list[SkinPatch]:
        """Patches that may be hands -> the accepted ones, best first; `face`: face width in px."""
        candidates = []
        previous = list(self._candidates)
        for patch in patches:
            if patch.moved < MOVED:
                continue
            near = [c for c in previous if _distance(c.patch.centre, patch.centre) < LEAP * face]
            frames = 1
            if near:
                nearest = min(near, key=lambda c: _distance(c.patch.centre, patch.centre))
                previous = [c for c in previous if c is not nearest]
                frames += nearest.frames
            candidates.append(Candidate(patch, frames))
        self._candidates = candidates
        best_first = sorted(candidates, key=lambda c: (-c.frames, -c.patch.area))
        return [c.patch for c in best_first if c.frames >= FRAMES]

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
