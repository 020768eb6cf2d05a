"""The face, found by OpenCV's own cascade where its wheel has one."""

from pathlib import Path

import cv2

from common.errors import BadInput
from observer.tracking.skin import Picture

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
