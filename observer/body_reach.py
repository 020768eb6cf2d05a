"""How large the body looks, from the distances of its parts. Pure; from past frames only."""

import math
from collections.abc import Sequence

import numpy as np

from common.errors import BadInput
from observer.tracks import Floats

TORSO_SHARE = 0.45
"""With a hanging arm, head and hand are about as far apart as head and hip plus a hand; 0.45 of it is about a torso."""
_SIDES = ("left", "right")
TORSO_LENGTHS = {
    **{("head", f"{side}_hand"): TORSO_SHARE for side in _SIDES},
    **{("head", f"{side}_foot"): 0.26 for side in _SIDES},
    **{("head", f"{side}_hip"): 0.61 for side in _SIDES},
    **{("neck", f"{side}_hip"): 0.82 for side in _SIDES},
    **{(f"{side}_shoulder", f"{other}_hip"): 0.92 for side, other in zip(_SIDES, _SIDES[::-1], strict=True)},
    **{(f"{side}_hip", f"{side}_knee"): 0.84 for side in _SIDES},
    **{(f"{side}_knee", f"{side}_foot"): 0.96 for side in _SIDES},
    ("head", "pelvis"): 0.67,
    ("neck", "pelvis"): 0.9,
}
"""Pairs of parts, and the torso's share of their distance, median over the people of karate and nw_ucla."""
FRAMES = 5
"""The size is a quantile over so many frames, so that one false frame does not decide."""


class BodyReach:
    """How large the body looks: distances of its parts, each as a multiple of what it is for a torso of length 1.

    Parts without a pair in TORSO_LENGTHS: the largest distance of any two, times TORSO_SHARE.
    """

    def __init__(self, body_parts: Sequence[str]) -> None:
        if len(body_parts) < 2:
            raise BadInput(f"body_parts = {list(body_parts)}: the body's size needs at least two parts; add head")
        row = {part: n for n, part in enumerate(body_parts)}
        pairs = [(row[a], row[b], share) for (a, b), share in TORSO_LENGTHS.items() if a in row and b in row]
        pairs = pairs or [(a, b, TORSO_SHARE) for b in range(len(row)) for a in range(b)]
        self._ends = np.array([[pair[0] for pair in pairs], [pair[1] for pair in pairs]])
        self._shares = np.array([pair[2] for pair in pairs])
        self.forget()

    def forget(self) -> None:
        """Start anew, with another person."""
        self._last: list[float] = []

    @property
    def steady(self) -> bool:
        """Whether one false frame can no longer decide."""
        return len(self._last) == FRAMES

    def update(self, centres: Floats) -> float:
        """(P, 2) -> the third largest of the last FRAMES frames' sizes; NaN until one is known.

        A frame's size is its largest length, or with many pairs one that a quarter of them reach, so that one false
        part does not decide.
        """
        ones, others = centres[self._ends]
        across = ones - others
        lengths = np.hypot(across[:, 0], across[:, 1]) * self._shares
        lengths = lengths[lengths > 0]
        lengths.sort()
        if len(lengths):
            self._last = [*self._last[1 - FRAMES :], float(lengths[-1 - len(lengths) // 4])]
        return sorted(self._last)[(len(self._last) - 1) // 2] if self._last else math.nan
