"""One picture as the tracker sees it: skin, what moved, what is new, about the person and no finer than is needed."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from observer.tracking.patch import Patch
from observer.tracking.skin import Picture, Skin
from observer.tracking.window import Region, blobs, camshift, erase
from observer.tracks import Floats

FACE_PX = 20.0
"""Pictures are looked at in steps of so many pixels that a face is about as wide as this; a hand is half as wide."""
SKIN_TONED = 0.15
"""Share of the surroundings in skin colour that stands still, from which on only what is new counts."""
Mask = tuple[Floats, tuple[float, float]]
"""An ellipse not to be looked at: centre (2,) and half axes, px of the picture."""


def step_for(face: float) -> int:
    """Pixels of the picture to one of the retina, for a face so many px wide."""
    return max(1, round(face / FACE_PX))


def shrunk(picture: Picture, step: int) -> Picture:
    """The whole picture, one pixel for step x step."""
    if step == 1:
        return picture
    size = (max(picture.shape[1] // step, 1), max(picture.shape[0] // step, 1))
    return cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR)


@dataclass(frozen=True, slots=True)
class Retina:
    """back, moved, fresh: (h, w) uint8 of the surroundings, 0 to 255; places and areas are in px of the whole picture.

    step: px of the picture to one of these; origin: (2,) of these, the corner. crowded: the surroundings are of skin
    colour, and `back` shows of them only what is fresh.
    """

    skin: Picture
    back: Picture
    moved: Picture
    step: int
    region: Region

    @classmethod
    def of(cls, small: Picture, step: int, skin: Skin, masks: Sequence[Picture], region: Region) -> "Retina":
        """From a `shrunk` picture; masks: what moved, what is new, and what of the region is backdrop."""
        everything = skin.back_project(region.cut(small))
        moved, fresh, stale = region.cut(masks[0]), region.cut(masks[1]), masks[2]
        # Before a wall of skin colour a hand is known by being new there; elsewhere old skin is no hand.
        crowded = cv2.countNonZero(cv2.bitwise_and(stale, cv2.bitwise_not(fresh))) > SKIN_TONED * stale.size
        shown = fresh if crowded else cv2.bitwise_or(cv2.bitwise_not(stale), cv2.bitwise_or(fresh, moved))
        return cls(everything, cv2.bitwise_and(everything, shown), moved, step, region)

    def camshift(
        self, start: Floats, side: float, wide: float, masks: Sequence[Mask], head: bool = False
    ) -> Patch | None:
        """CAMshift from a window of `side` about `start`, looking no further than `wide`."""
        place, half = self._inside(start), wide / self.step
        window = Region.around(place, (half, half), self.back.shape)
        back = window.cut(self.skin if head else self.back).copy()
        for centre, axes in masks:
            erase(back, self._inside(centre) - window.origin, (axes[0] / self.step, axes[1] / self.step))
        found = camshift(back, place - window.origin, side / self.step)
        return None if found is None else self._outside(Patch(found.centre + window.origin, found.area))

    def blobs(self, masks: Sequence[Mask], smallest: float, largest: float, backdrop: bool = False) -> list[Patch]:
        """All pieces of skin with areas between the two, largest first; with what is backdrop, if asked."""
        back = (self.skin if backdrop else self.back).copy()
        for centre, axes in masks:
            erase(back, self._inside(centre), (axes[0] / self.step, axes[1] / self.step))
        return [self._outside(p) for p in blobs(back, smallest / self.step**2, largest / self.step**2)]

    def _inside(self, centre: Floats) -> Floats:
        inside: Floats = (centre + 0.5) / self.step - 0.5 - self.region.origin
        return inside

    def _outside(self, patch: Patch) -> Patch:
        half = float(np.sqrt(patch.area)) / 2
        window = Region.around(patch.centre, (half, half), self.back.shape)
        size = (window.x1 - window.x0) * (window.y1 - window.y0)
        moved = cv2.countNonZero(window.cut(self.moved)) / size
        centre = (patch.centre + self.region.origin + 0.5) * self.step - 0.5
        return Patch(centre, patch.area * self.step**2, moved)
