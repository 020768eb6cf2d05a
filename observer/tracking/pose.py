"""Pose models as trackers: the landmarks of a person become named body parts."""

import os
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Literal, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.tracking.sides import SideKeeper
from observer.tracks import BODY_PARTS, WHOLE_BODY, Floats, Frame, SeenPeople, Tracks, require_picture

LANDMARKS = 33
"""Landmarks of BlazePose (Bazarevsky et al., BlazePose: on-device real-time body pose tracking, 2020, figure 3)."""


class PoseModel(Protocol):
    """Finds the landmarks of the most prominent person and follows them from picture to picture."""

    def landmarks(self, rgb: NDArray[np.uint8], ms: int) -> Floats | None:
        """(H, W, 3) RGB -> (33, 3) u and v as shares of width and height, visibility 0 to 1; None without a person.

        ms: time of the picture, greater than that of the previous one.
        """

    def close(self) -> None:
        """Release the threads of the model; no picture may follow."""


Hand = Literal["palm", "wrist"]

LEFT_HAND: Mapping[Hand, tuple[int, ...]] = {"palm": (15, 17, 19), "wrist": (15,)}
"""Landmarks whose mean is the left hand: wrist, and the knuckles of little and index finger; those of the right hand
have the next number. Depth cameras report the palm, even in recordings that call it wrist."""
LEFT: Mapping[str, tuple[int, ...]] = {
    "elbow": (13,), "shoulder": (11,), "hip": (23,), "knee": (25,), "foot": (27, 31)
}  # fmt: skip
"""Landmarks whose mean is a part of the left side; those of the right side have the next number. A foot is the middle
between ankle and toes."""
MIDDLE: Mapping[str, tuple[int, ...]] = {"head": (7, 8), "neck": (11, 12), "pelvis": (23, 24)}
"""The head is the middle between the ears, from all sides, as in recordings of depth cameras."""
SEEN = 0.5
"""Visibility from which a part is seen: MediaPipe's own threshold for its confidences."""
UNSURE = 0.2
"""Visibility from which the model's position of a hidden part is shown as a guess."""
NOBODY_S = 2.0
"""Time without a person before a complaint; people turn, stoop and pass behind things."""
COMPLAINT = (
    "the tracker {} finds nobody: the picture must show a person at least from head to hips, in good light;"
    " for face and hands alone use the tracker camshift"
)


def require_hand(hand: str) -> None:
    """Raises BadInput unless `hand` is palm or wrist."""
    if hand not in LEFT_HAND:
        raise BadInput(f"hand = {hand!r}: unknown; known: {', '.join(LEFT_HAND)}")


def landmarks_of(part: str, hand: Hand = "palm") -> tuple[int, ...]:
    """The landmarks whose mean is a part of WHOLE_BODY; raises BadInput for another part."""
    if part in MIDDLE:
        return MIDDLE[part]
    side, _, kind = part.partition("_")
    left = LEFT_HAND[hand] if kind == "hand" else LEFT.get(kind, ())
    if not left or side not in ("left", "right"):
        raise BadInput(f"body part {part!r}: pose models find {', '.join(WHOLE_BODY)}")
    return left if side == "left" else tuple(n + 1 for n in left)


class PoseUse:
    """What trackers by pose models share: the times of pictures, a complaint, and that models are closed with them.

    name: the tracker's, for complaints. close_models: is called at the latest at exit, because mediapipe prints a
    traceback when it is deleted while open.
    """

    def __init__(self, name: str, close_models: Callable[[], None]) -> None:
        self._name, self._closing = name, weakref.finalize(self, close_models)
        self._first_ns: int | None = None
        self._ms, self._someone_ms = 0, 0

    @property
    def complaint(self) -> str:
        """What to do when nobody was found for NOBODY_S; "" when all is well."""
        return COMPLAINT.format(self._name) if self._ms - self._someone_ms > 1000 * NOBODY_S else ""

    def close(self) -> None:
        """Release the threads of the model; no picture may follow."""
        self._closing()

    def _after(self, at_ns: int) -> int:
        """Milliseconds since the first frame, strictly increasing: the model rejects repeated times."""
        if self._first_ns is None:
            self._first_ns = at_ns
        return max(self._ms + 1, 1 + round((at_ns - self._first_ns) / 1e6))


class PoseTracker(PoseUse):
    """A `Tracker` of pictures (H, W, 3) uint8 BGR; centres in px of the picture.

    model: closed with the tracker. name: as of `PoseUse`. hand: the centre of a hand is the middle of
    the palm or the wrist. body_parts: of WHOLE_BODY, in any order. Mirrored pictures exchange left and right. Raises
    BadInput for an unknown hand or part.
    """

    def __init__(
        self, model: PoseModel, name: str, hand: Hand = "palm", body_parts: Sequence[str] = BODY_PARTS
    ) -> None:
        require_hand(hand)
        super().__init__(name, model.close)
        self.body_parts: Sequence[str] = tuple(body_parts)
        """The parts that it finds: left and right of the person."""
        self._rows = [landmarks_of(part, hand) for part in body_parts]
        self._model, self._sides, self._choices = model, SideKeeper(), 0

    def update(self, frame: Frame) -> Tracks:
        """Centres (P, 2) px of the followed person, NaN for a part not seen; BadInput for a wrong shape."""
        picture = require_picture(frame.content)
        self._ms = self._after(frame.at_ns)
        rgb = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)
        landmarks = self._model.landmarks(rgb, self._ms)
        people: SeenPeople | None = getattr(self._model, "people", None)
        if landmarks is None:
            return Tracks(np.full((len(self._rows), 2), np.nan), people=people)
        self._someone_ms = self._ms
        height, width = picture.shape[:2]
        choices = getattr(self._model, "choices", 0)
        if choices != self._choices:
            self._choices, self._sides = choices, SideKeeper()
        landmarks = self._sides.update(landmarks, self._ms, width / height)
        return replace(read_pose(landmarks, (width, height), self._rows), people=people)


def read_pose(landmarks: Floats, size_px: tuple[int, int], rows: Sequence[Sequence[int]]) -> Tracks:
    """(33, 3) u and v as shares of size_px = (width, height), visibility 0 to 1 -> Tracks (P, 2) in px.

    rows: the landmarks of each part, `landmarks_of`. A part's centre and visibility are the means over its landmarks.
    It is seen from a visibility of SEEN, a guess from UNSURE, else missing; outside the picture it is always missing.
    """
    means = np.array([landmarks[list(part)].mean(axis=0) for part in rows])
    inside = ((means[:, :2] >= 0) & (means[:, :2] < 1)).all(axis=1)
    sure = np.where(inside, means[:, 2], 0.0)
    centres = means[:, :2] * np.array(size_px, dtype=np.float64)
    return Tracks(_where(sure >= SEEN, centres), _where((sure >= UNSURE) & (sure < SEEN), centres))


def _where(chosen: NDArray[np.bool_], centres: Floats) -> Floats:
    return np.where(chosen[:, None], centres, np.nan)


@contextmanager
def stderr_silenced() -> Iterator[None]:
    """Drop what native code writes about a model while it is read, beside its exceptions; no setting silences it."""
    stderr, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(null)
