"""A piece of skin found in a picture: what the eyes hand to the decisions."""

from dataclasses import dataclass

from observer.tracks import Floats


@dataclass(frozen=True, slots=True)
class Patch:
    """A piece of skin: centre (2,) px, area in px² of skin-coloured pixels, moved: share of it that moved, 0 to 1."""

    centre: Floats
    area: float
    moved: float = 0.0
