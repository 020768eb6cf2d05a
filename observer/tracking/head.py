"""Finding and following the head: OpenCV's face cascade, or the topmost patch of a known skin colour."""

from pathlib import Path

import cv2
import numpy as np

from common.errors import BadInput
from observer.tracking.back_projection import SKIN, PixelRect
from observer.tracking.skin import Picture, SkinHistogram
from observer.tracks import Floats

Box = tuple[int, int, int, int]
CASCADE = "haarcascade_frontalface_alt2.xml"
WHY_NOT = (
    f"OpenCV {cv2.__version__}: this wheel has no face cascade; mark a region of skin or name a saved histogram, "
    "or install opencv-python-headless>=4.11,<5"
)


def have_cascade() -> bool:
    """Whether this OpenCV can find faces; where not, `WHY_NOT` says what to do."""
    return hasattr(cv2, "CascadeClassifier") and (Path(_folder()) / CASCADE).exists()


def _folder() -> str:
    return str(getattr(getattr(cv2, "data", None), "haarcascades", "no such folder"))


class FaceFinder:
    """Finds frontal faces; BadInput where OpenCV has no cascade."""

    def __init__(self) -> None:
        if not have_cascade():
            raise BadInput(WHY_NOT)
        self._cascade = cv2.CascadeClassifier(str(Path(_folder()) / CASCADE))

    def find(self, picture: Picture, smallest: int) -> list[Box]:
        """Boxes x, y, width, height of the faces in (H, W, 3) BGR, at least `smallest` px wide, largest first."""
        if min(picture.shape[:2]) < smallest:
            return []
        grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        found = self._cascade.detectMultiScale(grey, scaleFactor=1.1, minNeighbors=4, minSize=(smallest, smallest))
        boxes = [(int(x), int(y), int(w), int(h)) for x, y, w, h in found]
        return sorted(boxes, key=lambda box: -box[2])


LOOKED_AT = 240
"""Pictures are made so small, px of the shorter side."""
AREAS = (1 / 4000, 1 / 30)
"""Least and largest share of the picture that the skin of a head has."""
MOST_PATCHES = 6
"""With more patches than a head, two hands, a neck and feet show, the background has the colour of skin."""
ABOVE = 1.0
"""A second patch is at least so many widths of the head lower, or the topmost one may be a hand."""
FACE_PER_ROOT = {"towards": 1.15, "away": 2.2}
"""Width of a face per square root of its visible skin: as the cascade's boxes about it, on rendered people; of who
turns his back a cheek, an ear and the neck show."""


def topmost_skin(picture: Picture, skin: SkinHistogram, away: bool = False) -> Box | None:
    """(H, W, 3) BGR -> x, y, width, height px of a square about the head; None where none can be told.

    away: the person turns his back to the camera, and shows less skin of the head. Standing with the hands down, the
    topmost skin of a person is the head's. Nothing is told where the whole picture is full of such patches, or where
    two are equally high.
    """
    scale = max(1.0, min(picture.shape[:2]) / LOOKED_AT)
    size = (round(picture.shape[1] / scale), round(picture.shape[0] / scale))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    mask: Picture = (skin.back_project(small) >= SKIN).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, _, stats, centres = cv2.connectedComponentsWithStats(mask)
    areas = stats[1:count, cv2.CC_STAT_AREA] / mask.size
    large = [1 + int(i) for i in np.flatnonzero((areas >= AREAS[0]) & (areas <= AREAS[1]))]
    if not large or len(large) > MOST_PATCHES or (areas > AREAS[1]).any():
        return None
    large.sort(key=lambda label: float(centres[label][1]))
    width = FACE_PER_ROOT["away" if away else "towards"] * float(np.sqrt(stats[large[0], cv2.CC_STAT_AREA]))
    u, v = centres[large[0]]
    if len(large) > 1 and centres[large[1]][1] - v < ABOVE * width:
        return None
    x, y, side = (u - width / 2) * scale, (v - width / 2) * scale, width * scale
    return round(x), round(y), round(side), round(side)


SHORT_SIDE = 480
"""Faces are looked for in pictures no larger than this; one that is followed, where it is about this wide:"""
FOLLOWED_PX = 36
SMALLEST = 20
"""The narrowest face that the cascade knows, px of what it looks at."""
EVERY_S, HUNTING_S = 0.3, 0.1
"""The cascade, which costs most, looks so often, while a head is followed and while there is none."""
NEAR = 0.6
"""Two finds within so many face widths are the same face; the first alone may be a false one."""
STRAYED, DOUBTED_S, LOST_S = 1.0, 1.0, 3.0
"""Further than so many face widths from the last face found, a head is doubted after so long, and then lost."""
ADAPT_S, ADAPT, AGAIN = 0.3, 0.1, 0.3
"""So often, which share of a newer histogram is taken in, and which when the face was lost and found again."""


class HeadTracker:
    """Face width (px, None until found) and skin (None until learned)."""

    def __init__(self, finder: FaceFinder | None, skin: SkinHistogram | None, away: bool = False) -> None:
        self._finder, self._away = finder, away
        self._candidate: Box | None = None
        self._unlooked_s, self._unadapted_s = HUNTING_S, 0.0
        self._unconfirmed_s, self._confirmed_at = 0.0, np.zeros(2)
        self.skin: SkinHistogram | None = skin
        self.face: float | None = None
        self._given, self._faced = skin is not None, False

    def begin(self, picture: Picture, box: Box) -> bool:
        """Take `box` for the face; False where its colours teach nothing."""
        if not self._given:
            learned = SkinHistogram.learn(picture, box)
            if learned is None:
                return False
            # Found again: what was known of this person weighs more than a face that may be a false one.
            self.skin = learned if self.skin is None else self.skin.adapted(learned, AGAIN)
        self.face = float(box[2])
        self._place(box)
        return True

    def confirm(self, box: Box) -> None:
        """The face was found here, by the cascade."""
        self._faced = True
        self._place(box)

    def _place(self, box: Box) -> None:
        self._unconfirmed_s, self._confirmed_at = 0.0, middle(box)

    def strayed_s(self, centre: Floats) -> float:
        """Seconds without a face found, if the head's `centre` (2,) has left the place of the last one; else 0.

        0 too while there has been no face: a head that was marked, or found by its skin, need not show one.
        """
        away = float(np.linalg.norm(centre - self._confirmed_at))
        return self._unconfirmed_s if self._faced and away > STRAYED * (self.face or 0) else 0.0

    def look(self, picture: Picture, near: Floats | None, seconds: float) -> Box | None:
        """The face, looked for near (2,) px if given; None between looks and where it is not found twice."""
        self._unlooked_s += seconds
        self._unconfirmed_s += seconds
        hunting = near is None
        due = self._unlooked_s >= (HUNTING_S if hunting else EVERY_S) - 1e-6 or (hunting and self._candidate)
        if not due or (self._finder is None and not hunting):
            return None
        self._unlooked_s = 0.0
        if near is None:
            # Who turns his back and has a known colour will show no face, and the search costs more than all else.
            hopeless = self._away and self._given
            found = [] if hopeless else self._found(picture, max(1.0, min(picture.shape[:2]) / SHORT_SIDE), SMALLEST)
            self._faced = bool(found)
            return self._twice(found[0] if found else self._by_skin(picture))
        width = self.face or SMALLEST
        region = PixelRect.around(near, (1.2 * width, 1.2 * width), picture.shape)
        scale = max(1.0, width / FOLLOWED_PX)
        boxes = self._found(region.cut(picture), scale, max(int(0.7 * width / scale), SMALLEST))
        fitting = [(x + region.x0, y + region.y0, w, h) for x, y, w, h in boxes if w < 1.6 * width]
        return min(fitting, key=lambda box: float(np.linalg.norm(middle(box) - near)), default=None)

    def _found(self, picture: Picture, scale: float, smallest: int) -> list[Box]:
        """Faces, looked for in the picture made smaller by `scale`, in px of the picture given."""
        size = (max(round(picture.shape[1] / scale), 1), max(round(picture.shape[0] / scale), 1))
        small = picture if scale == 1 else cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR)
        found = [] if self._finder is None else self._finder.find(small, smallest)
        return [(round(x * scale), round(y * scale), round(w * scale), round(h * scale)) for x, y, w, h in found]

    def _by_skin(self, picture: Picture) -> Box | None:
        """Where no face is found, a head of known skin colour; a learned colour may be that of a false face."""
        return topmost_skin(picture, self.skin, self._away) if self._given and self.skin is not None else None

    def _twice(self, box: Box | None) -> Box | None:
        before, self._candidate = self._candidate, box
        if box is None or before is None:
            return None
        same = np.linalg.norm(middle(box) - middle(before)) < NEAR * box[2] and 0.7 < box[2] / before[2] < 1.4
        return box if same else None

    def adapt(self, picture: Picture, small: Picture, step: int, centre: Floats, seconds: float) -> None:
        """Learn a little from the face at `centre` (2,) px, now and then; the caller knows that no hand is before it.

        small: the whole picture, one pixel for step x step.
        """
        self._unadapted_s += seconds
        if not self.face or self.skin is None or self._unadapted_s < ADAPT_S:
            return
        if self._finder is not None and self._unconfirmed_s > 0:
            return  # a window that slid onto a wall would teach the wall's colour
        self._unadapted_s = 0.0
        near = PixelRect.around(centre, (self.face, self.face), picture.shape)
        x, y = centre - self.face / 2 - near.origin
        rest, half = small.copy(), 0.75 * self.face / step
        PixelRect.around(centre / step, (half, half), rest.shape).cut(rest)[:] = 0
        newer = SkinHistogram.learn(near.cut(picture), (int(x), int(y), int(self.face), int(self.face)), rest)
        if newer is not None:
            self.skin = self.skin.adapted(newer, ADAPT)

    def widen(self, width: float) -> None:
        """The face was found to be `width` px wide."""
        self.face = 0.8 * (self.face or width) + 0.2 * width


def middle(box: Box) -> Floats:
    """(2,) px: the centre of a box."""
    return np.array([box[0] + box[2] / 2, box[1] + box[3] / 2])
