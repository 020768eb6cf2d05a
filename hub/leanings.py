"""Facets as listeners are told them: to which of two poles each leans, and which way the person faces. Pure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from common.facets import FACETS


@dataclass(frozen=True, slots=True)
class Leaning:
    """One facet: its likeliest value and that one's probability; lean: -1 is all at the first pole, 1 at the last."""

    facet: str
    value: str
    p: float
    lean: float

    @property
    def poles(self) -> tuple[str, str]:
        """The names of the two ends."""
        return FACETS[self.facet][0], FACETS[self.facet][-1]

    @property
    def name(self) -> str:
        """What it is called beside its poles: `time`, `horizontal`."""
        return self.facet.partition("_")[2]


def leanings(facets: Mapping[str, Sequence[float]] | None) -> tuple[Leaning, ...]:
    """Those that are known and are said, in the order of FACETS; what is no distribution is left out."""
    said = ((facet, (facets or {}).get(facet)) for facet in FACETS)
    return tuple(_leaning(facet, p) for facet, p in said if p is not None and _fits(facet, p))


def facing(facing_deg: float | None) -> float | None:
    """0 to 360 degrees to the left, or None where nobody says it."""
    if facing_deg is None or not math.isfinite(facing_deg):
        return None
    return facing_deg % 360


def facing_words(facing_deg: float, degree: str = "°") -> str:
    """`front`, `45° left`, `90° right`, `back`."""
    left = (round(facing_deg) + 180) % 360 - 180
    if left in (0, -180):
        return "back" if left else "front"
    return f"{abs(left)}{degree} {'left' if left > 0 else 'right'}"


def _leaning(facet: str, p: Sequence[float]) -> Leaning:
    most = max(range(len(p)), key=lambda place: p[place])
    return Leaning(facet, FACETS[facet][most], p[most], p[-1] - p[0])


def _fits(facet: str, p: Sequence[float]) -> bool:
    return len(p) == len(FACETS[facet]) and all(0 <= each <= 1 for each in p)
