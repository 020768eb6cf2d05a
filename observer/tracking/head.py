"""Finding and following the head: OpenCV's face cascade, or the topmost patch of a known skin colour."""

from pathlib import Path

import cv2
import numpy as np

from common.errors import BadInput
from observer.tracking.back_projection import SKIN, PixelRect
from observer.tracking.skin import Picture, SkinHistogram
from observer.tracks import Floats

Box = tuple[int, int, int, int]
"""x, y, width, height in px."""
CASCADE = "haarcascade_frontalface_alt2.xml"
NO_CASCADE = (
    f"OpenCV {cv2.__version__}: this wheel has no face cascade; mark a region of skin or name a saved histogram, "
    "or install opencv-python-headless>=4.11,<5"
)


def have_cascade() -> bool:
    """Whether this OpenCV can find faces; otherwise `NO_CASCADE` says what to do."""
    return hasattr(cv2, "CascadeClassifier") and (Path(_folder()) / CASCADE).exists()


def _folder() -> str:
    return str(getattr(getattr(cv2, "data", None), "haarcascades", "no such folder"))


class FaceFinder:
    """Finds frontal faces (Viola and Jones 2001); raises BadInput where OpenCV has no cascade."""

    def __init__(self) -> None:
        if not have_cascade():
            raise BadInput(NO_CASCADE)
        self._cascade = cv2.CascadeClassifier(str(Path(_folder()) / CASCADE))

    def find(self, picture: Picture, smallest: int) -> list[Box]:
        """The faces in (H, W, 3) BGR that are at least `smallest` px wide, largest first."""
        if min(picture.shape[:2]) < smallest:
            return []
        grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        faces = self._cascade.detectMultiScale(grey, scaleFactor=1.1, minNeighbors=4, minSize=(smallest, smallest))
        return sorted(((int(x), int(y), int(w), int(h)) for x, y, w, h in faces), key=lambda box: -box[2])


SKIN_SHORT_SIDE = 240
"""`topmost_skin` reduces pictures to this shorter side, px."""
FACE_AREAS = (1 / 4000, 1 / 30)
"""Least and largest share of the picture that the skin of a head has."""
MOST_PATCHES = 6
"""More patches than head, two hands, neck and feet: the background has the colour of skin."""
ABOVE = 1.0
"""The second patch must be at least this many head widths lower, otherwise the topmost may be a hand."""
FACE_PER_ROOT = {"towards": 1.15, "away": 2.2}
"""Face width per square root of visible skin area, calibrated to the cascade's boxes on rendered people; from behind
only a cheek, an ear and the neck are visible."""


def topmost_skin(picture: Picture, skin: SkinHistogram, away: bool = False) -> Box | None:
    """(H, W, 3) BGR -> a square about the head, or None. For cameras at the side or behind, where no face is visible.

    away: the person turns their back to the camera and shows less skin of the head. The topmost skin of a person
    standing with the hands down belongs to the head. None where skin-coloured patches are many, too large, or two of
    them are equally high.
    """
    scale = max(1.0, min(picture.shape[:2]) / SKIN_SHORT_SIDE)
    size = (round(picture.shape[1] / scale), round(picture.shape[0] / scale))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    mask: Picture = (skin.back_project(small) >= SKIN).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, _, stats, centres = cv2.connectedComponentsWithStats(mask)
    areas = stats[1:count, cv2.CC_STAT_AREA] / mask.size
    large = [1 + int(i) for i in np.flatnonzero((areas >= FACE_AREAS[0]) & (areas <= FACE_AREAS[1]))]
    if not large or len(large) > MOST_PATCHES or (areas > FACE_AREAS[1]).any():
        return None
    large.sort(key=lambda label: float(centres[label][1]))
    width = FACE_PER_ROOT["away" if away else "towards"] * float(np.sqrt(stats[large[0], cv2.CC_STAT_AREA]))
    u, v = centres[large[0]]
    if len(large) > 1 and centres[large[1]][1] - v < ABOVE * width:
        return None
    x, y, side = (u - width / 2) * scale, (v - width / 2) * scale, width * scale
    return round(x), round(y), round(side), round(side)


FACE_SIDE_PX = 480
"""The cascade searches pictures reduced to this shorter side, px."""
FOLLOWED_PX = 36
"""About a tracked head, the picture is reduced so that the face is this wide."""
LEAST_FACE_PX = 20
"""The narrowest face that the cascade knows, px."""
FOLLOW_EVERY_S, SEARCH_EVERY_S = 0.3, 0.1
"""Interval of the cascade, the most expensive step, while a head is tracked and when it was just lost."""
SEARCH_FIRST_S, SEARCH_LATER, SEARCH_LAST_S = 2.0, 0.25, 1.0
"""When no face was found for the first of these times, the whole picture, or the surroundings of a head that is
followed, are searched ever less often: at intervals of this share of the time since then, and of the last time at
most."""
NEAR = 0.6
"""Two detections within this many face widths are the same face; a single one may be false."""
STRAYED, DOUBTED_S, LOST_S = 1.0, 1.0, 3.0
"""A head farther than STRAYED face widths from the last detected face is unsure after DOUBTED_S, then missing."""
ADAPT_S, ADAPT, ADAPT_AGAIN = 0.3, 0.1, 0.3
"""Interval of adaptation, the weight of the newer histogram, and its weight when the face was lost and found again."""


class HeadTracker:
    """Detects and follows the head. face: its width in px, None until found. skin: None until learned."""

    def __init__(self, finder: FaceFinder | None, skin: SkinHistogram | None, away: bool = False) -> None:
        self._finder, self._away = finder, away
        self._candidate: Box | None = None
        self._since_search_s, self._since_adapted_s = SEARCH_EVERY_S, 0.0
        self._since_whole_s, self._headless_s = SEARCH_EVERY_S, 0.0
        self._unconfirmed_s, self._confirmed_at = 0.0, np.zeros(2)
        self.skin: SkinHistogram | None = skin
        self.face: float | None = None
        self._given, self._faced = skin is not None, False

    def begin(self, picture: Picture, box: Box) -> bool:
        """Accept `box` as the face; False when its colours are not usable."""
        if not self._given:
            learned = SkinHistogram.learn(picture, box)
            if learned is None:
                return False
            # Found again: the known colours of this person weigh more than a face that may be false.
            self.skin = learned if self.skin is None else self.skin.adapted(learned, ADAPT_AGAIN)
        self.face = float(box[2])
        self._place(box)
        return True

    def confirm(self, box: Box) -> None:
        """Note that the cascade has detected the face here."""
        self._faced = True
        self._place(box)

    def _place(self, box: Box) -> None:
        self._unconfirmed_s, self._confirmed_at = 0.0, middle(box)

    def strayed_s(self, centre: Floats) -> float:
        """Seconds since the last detected face, if the head's `centre` (2,) has left its position; else 0.

        Also 0 while no face was ever detected: a head that was marked, or found by its skin, need not show one.
        """
        distance = float(np.linalg.norm(centre - self._confirmed_at))
        return self._unconfirmed_s if self._faced and distance > STRAYED * (self.face or 0) else 0.0

    def search(self, picture: Picture, near: Floats | None, seconds: float) -> Box | None:
        """Search the face, near (2,) px if given; None between searches, and for a face not detected twice."""
        self._since_search_s += seconds
        self._since_whole_s += seconds
        self._unconfirmed_s += seconds
        self._headless_s = self._headless_s + seconds if near is None else 0.0
        interval_s = SEARCH_EVERY_S if near is None else _interval_s(FOLLOW_EVERY_S, self._unconfirmed_s)
        due = self._since_search_s >= interval_s - 1e-6 or (near is None and self._candidate)
        if not due or (self._finder is None and near is not None):
            return None
        self._since_search_s = 0.0
        if near is not None:
            return self._face_near(picture, near, self.face or LEAST_FACE_PX)
        # The colour of skin takes a twentieth of the time that the cascade takes for the whole picture.
        # A learned colour is not used, since it may come from a false face.
        box = topmost_skin(picture, self.skin, self._away) if self._given and self.skin is not None else None
        if box is None:
            faces = self._faces(picture)
            box = faces[0] if faces else None
            self._faced = bool(faces)
        else:
            face = None if self._away else self._face_near(picture, middle(box), box[2])
            box, self._faced = face or box, face is not None
        return self._confirmed_twice(box)

    def _face_near(self, picture: Picture, near: Floats, width: float) -> Box | None:
        """The face of about this width that is nearest to `near` (2,) px."""
        region = PixelRect.around(near, (1.2 * width, 1.2 * width), picture.shape)
        scale = max(1.0, width / FOLLOWED_PX)
        boxes = self._detect(region.cut(picture), scale, max(int(0.7 * width / scale), LEAST_FACE_PX))
        fitting = [(x + region.x0, y + region.y0, w, h) for x, y, w, h in boxes if w < 1.6 * width]
        return min(fitting, key=lambda box: float(np.linalg.norm(middle(box) - near)), default=None)

    def _faces(self, picture: Picture) -> list[Box]:
        """Faces in the whole picture when a search is due or one was just found, largest first; else none."""
        if self._away and self._given:
            return []  # a person of known skin colour seen from behind shows no face
        scale = max(1.0, min(picture.shape[:2]) / FACE_SIDE_PX)
        due = self._since_whole_s >= _interval_s(SEARCH_EVERY_S, self._headless_s) - 1e-6
        # The second look is at the whole picture too: at the place alone, more false faces are found twice.
        if not due and self._candidate is None:
            return []
        self._since_whole_s = 0.0
        return self._detect(picture, scale, LEAST_FACE_PX)

    def _detect(self, picture: Picture, scale: float, smallest: int) -> list[Box]:
        """Faces in px of `picture`, searched in the picture reduced by `scale`."""
        size = (max(round(picture.shape[1] / scale), 1), max(round(picture.shape[0] / scale), 1))
        small = picture if scale == 1 else cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR)
        faces = [] if self._finder is None else self._finder.find(small, smallest)
        return [(round(x * scale), round(y * scale), round(w * scale), round(h * scale)) for x, y, w, h in faces]

    def _confirmed_twice(self, box: Box | None) -> Box | None:
        previous, self._candidate = self._candidate, box
        if box is None or previous is None:
            return None
        same = np.linalg.norm(middle(box) - middle(previous)) < NEAR * box[2] and 0.7 < box[2] / previous[2] < 1.4
        return box if same else None

    def adapt(self, picture: Picture, small: Picture, step: int, centre: Floats, seconds: float) -> None:
        """Adapt the histogram to the face at `centre` (2,) px, every ADAPT_S; no hand may be in front of it.

        small: the whole picture, reduced by `step`.
        """
        self._since_adapted_s += seconds
        if not self.face or self.skin is None or self._since_adapted_s < ADAPT_S:
            return
        if self._finder is not None and self._unconfirmed_s > 0:
            return  # a window that has slid onto a wall would teach the wall's colour
        self._since_adapted_s = 0.0
        near = PixelRect.around(centre, (self.face, self.face), picture.shape)
        x, y = centre - self.face / 2 - near.origin
        rest, half = small.copy(), 0.75 * self.face / step
        PixelRect.around(centre / step, (half, half), rest.shape).cut(rest)[:] = 0
        newer = SkinHistogram.learn(near.cut(picture), (int(x), int(y), int(self.face), int(self.face)), rest)
        if newer is not None:
            self.skin = self.skin.adapted(newer, ADAPT)

    def widen(self, width: float) -> None:
        """Smooth the face width with a new measurement, px."""
        self.face = 0.8 * (self.face or width) + 0.2 * width


def _interval_s(first_s: float, faceless_s: float) -> float:
    """The interval of the cascade when no face was found for so long."""
    return min(max(first_s, SEARCH_LATER * (faceless_s - SEARCH_FIRST_S)), SEARCH_LAST_S)


def middle(box: Box) -> Floats:
    """(2,) px centre of a box."""
    return np.array([box[0] + box[2] / 2, box[1] + box[3] / 2])
