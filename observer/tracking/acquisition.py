"""New hands: a moving piece of skin within the person's reach, there in several frames running."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.tracking.patch import Patch
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

    patch: Patch
    frames: int


class Acquisition:
    """Remembers candidates from frame to frame."""

    def __init__(self) -> None:
        self._before: list[Candidate] = []

    def update(self, patches: Sequence[Patch], face: float) -> list[Patch]:
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


def _apart(one: Floats, other: Floats) -> float:
    return float(np.linalg.norm(one - other))
