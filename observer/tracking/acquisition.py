"""New hands: a moving piece of skin within the person's reach, there in several frames running."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.tracking.back_projection import SkinPatch
from observer.tracks import Floats

FRAMES = 3
"""A candidate is believed when it was there in so many frames running."""
LEAP = 1.2
"""How far a candidate may go between two frames, face widths."""
MOVED = 0.3
"""Least share of a candidate's pixels that moved, in each of its frames: a lamp or a cupboard does not move."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A patch and for how many frames running it was there."""

    patch: SkinPatch
    frames: int


class HandAcquisition:
    """Remembers candidates from frame to frame."""

    def __init__(self) -> None:
        self._before: list[Candidate] = []

    def update(self, patches: Sequence[SkinPatch], face: float) -> list[SkinPatch]:
        """Patches that may be hands now; `face` is the face's width in px. The believed ones, best first."""
        now = []
        left = list(self._before)
        for patch in patches:
            if patch.moved < MOVED:
                continue
            near = [c for c in left if _apart(c.patch.centre, patch.centre) < LEAP * face]
            frames = 1
            if near:
                nearest = min(near, key=lambda c: _apart(c.patch.centre, patch.centre))
                left = [c for c in left if c is not nearest]
                frames += nearest.frames
            now.append(Candidate(patch, frames))
        self._before = now
        return [c.patch for c in sorted(now, key=lambda c: (-c.frames, -c.patch.area)) if c.frames >= FRAMES]

    def forget(self) -> None:
        """Begin again."""
        self._before = []


HANGS = ((0.6, 2.6), (3.0, 6.5))
"""Where hands hang: away from the head's middle and below it, face widths."""
RESTS_S, TREMBLES = 0.6, 0.3
"""A hanging hand is believed when it was there for so long, never further from itself than so many face widths."""


class RestingHands:
    """A hand that does not move: the only skin where a hand hangs, on its side of the body, for a while."""

    def __init__(self) -> None:
        self._seen: dict[int, tuple[Floats, float]] = {}

    def update(self, pieces: Sequence[SkinPatch], head: Floats, face: float, seconds: float) -> dict[int, SkinPatch]:
        """All pieces of skin in a frame -> those believed to be hanging hands, by side: -1 the picture's left, or 1."""
        believed, now = {}, {}
        for side in (-1, 1):
            here = [p for p in pieces if _hangs((p.centre - head) * (side, 1) / face)]
            if len(here) != 1:
                continue
            place, since = self._seen.get(side, (here[0].centre, 0.0))
            stayed = _apart(place, here[0].centre) < TREMBLES * face
            now[side] = (place, since + seconds) if stayed else (here[0].centre, 0.0)
            if now[side][1] >= RESTS_S:
                believed[side] = here[0]
        self._seen = now
        return believed


def _hangs(away: Floats) -> bool:
    (left, right), (top, bottom) = HANGS
    return bool(left < away[0] < right and top < away[1] < bottom)


def _apart(one: Floats, other: Floats) -> float:
    return float(np.hypot(*(one - other)))
