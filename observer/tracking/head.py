"""The head and what is learned from it: where the face is, how wide, and the colour of skin."""

import numpy as np

from observer.tracking.face import Box, FaceFinder
from observer.tracking.skin import Picture, Skin
from observer.tracking.window import Region
from observer.tracks import Floats

SMALLEST = 1 / 24
"""Faces narrower than this share of the picture's height are not looked for."""
EVERY, HUNTING = 4, 2
"""The cascade, which costs most, looks in one of so many frames, while a head is followed and while there is none."""
NEAR = 0.6
"""Two finds within so many face widths are the same face; the first alone may be a false one."""
ADAPT, AGAIN = 0.1, 0.3
"""Share of a newer histogram that is taken in at a time, and when the face was lost and found again."""


class Head:
    """Face width (px, None until found) and skin (None until learned)."""

    def __init__(self, finder: FaceFinder | None, skin: Skin | None) -> None:
        self._finder, self._frame = finder, 0
        self._candidate: Box | None = None
        self.skin: Skin | None = skin
        self.face: float | None = None
        self._given = skin is not None

    def begin(self, picture: Picture, box: Box) -> bool:
        """Take `box` for the face; False where its colours teach nothing."""
        if not self._given:
            learned = Skin.learn(picture, box)
            if learned is None:
                return False
            # Found again: what was known of this person weighs more than a face that may be a false one.
            self.skin = learned if self.skin is None else self.skin.adapted(learned, AGAIN)
        self.face = float(box[2])
        return True

    def look(self, picture: Picture, near: Floats | None) -> Box | None:
        """The face, looked for near (2,) px if given; None between looks and where it is not found twice."""
        self._frame += 1
        hunting = near is None
        if self._finder is None or (
            self._frame % (HUNTING if hunting else EVERY) and not (hunting and self._candidate)
        ):
            return None
        smallest = max(int(SMALLEST * picture.shape[0]), 16)
        if near is None:
            found = self._finder.find(picture, smallest)
            return self._twice(found[0] if found else None)
        width = self.face or smallest
        region = Region.around(near, (1.5 * width, 1.5 * width), picture.shape)
        boxes = self._finder.find(region.cut(picture), max(int(0.6 * width), smallest))
        fitting = [(x + region.x0, y + region.y0, w, h) for x, y, w, h in boxes if w < 1.6 * width]
        return min(fitting, key=lambda box: float(np.linalg.norm(middle(box) - near)), default=None)

    def _twice(self, box: Box | None) -> Box | None:
        before, self._candidate = self._candidate, box
        if box is None or before is None:
            return None
        same = np.linalg.norm(middle(box) - middle(before)) < NEAR * box[2] and 0.7 < box[2] / before[2] < 1.4
        return box if same else None

    def adapt(self, picture: Picture, centre: Floats) -> None:
        """Learn a little from the face at `centre` (2,) px; the caller knows that no hand is before it."""
        if not self.face or self.skin is None:
            return
        x, y = centre - self.face / 2
        newer = Skin.learn(picture, (int(x), int(y), int(self.face), int(self.face)))
        if newer is not None:
            self.skin = self.skin.adapted(newer, ADAPT)

    def widen(self, width: float) -> None:
        """The face was found to be `width` px wide."""
        self.face = 0.8 * (self.face or width) + 0.2 * width


def middle(box: Box) -> Floats:
    """(2,) px: the centre of a box."""
    return np.array([box[0] + box[2] / 2, box[1] + box[3] / 2])
