"""Variants of the webcam's two films: one film each would say little about other people who wave or stand."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from observer.tracks import Floats

WIDTH_PX = 420
"""Of the webcam's pictures."""
STARTS_S = (0.0, 1.0, 2.0, 3.0)
TEMPI = (0.8, 1.0, 1.25)
SCALES = (0.5, 1.0, 2.0)


@dataclass(frozen=True, slots=True)
class Variant:
    """mirrored: the other hand waves. start_s: what is cut off at the begin. tempo, scale: factors on speed and px."""

    mirrored: bool
    start_s: float
    tempo: float
    scale: float

    def __str__(self) -> str:
        side = "mirrored" if self.mirrored else "as it is"
        return f"{side}, from {self.start_s:g} s, tempo {self.tempo:g}, scale {self.scale:g}"

    def apply(self, centres: Floats, rate_hz: float) -> tuple[Floats, float]:
        """(F, 3, 2) px of left hand, right hand and head, and their rate -> the same of the variant."""
        shown = centres[round(self.start_s * rate_hz) :] * self.scale
        if self.mirrored:
            shown = shown[:, (1, 0, 2)]
            shown[..., 0] = WIDTH_PX * self.scale - shown[..., 0]
        return shown, rate_hz * self.tempo


def variants() -> Iterator[Variant]:
    """All of them; the scale changes with the start, so that they are few."""
    for mirrored, (n, start_s), tempo in product((False, True), enumerate(STARTS_S), TEMPI):
        yield Variant(mirrored, start_s, tempo, SCALES[n % len(SCALES)])
