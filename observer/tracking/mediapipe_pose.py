"""The tracker by MediaPipe's pose model: for real rooms, where skin colour is not enough."""

import weakref
from collections.abc import Mapping, Sequence
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.tracking.mediapipe_model import open_pose
from observer.tracks import BODY_PARTS, Floats, Frame, Tracks

Hand = Literal["palm", "wrist"]

LEFT_HAND: Mapping[Hand, tuple[int, ...]] = {"palm": (15, 17, 19), "wrist": (15,)}
"""BlazePose's landmarks whose mean is the left hand: wrist, and the knuckles of little and index finger; the right
hand's have the next number. The palm is where depth cameras put a hand, even where the recording calls it wrist."""
HEAD = (7, 8)
"""Both ears: the middle between them is the middle of the head, as depth cameras give it, from all sides."""

SEEN = 0.5
"""Visibility from which on a part is seen: MediaPipe's own threshold for its confidences."""
UNSURE = 0.2
"""Visibility from which on the model's place for a hidden part is shown as a guess."""

PATIENCE_S = 2.0
"""Nobody made out for so long is worth a word; people turn, stoop and pass behind things."""
COMPLAINT = (
    "the tracker mediapipe makes out nobody: bring the person, at least head to hips, and light into the picture;"
    " for face and hands alone take the tracker camshift"
)


class MediapipeTracker:
    """A `observer.tracks.Tracker` of pictures (H, W, 3) uint8 BGR; centres in px of the picture given.

    model_path: a pose landmarker .task file, or None for the model in mediapipe's wheel. hand: what a hand's centre is,
    the middle of the palm or the wrist. Pictures must not be mirrored, or left and right are exchanged. Raises
    BadInput without mediapipe, without a model, and for an unknown hand.
    """

    def __init__(self, model_path: str | None = None, hand: Hand = "palm") -> None:
        if hand not in LEFT_HAND:
            raise BadInput(f"hand = {hand!r}: unknown; known: {', '.join(LEFT_HAND)}")
        self._hand = hand
        self._model = open_pose(model_path)
        # At the latest when Python ends: left to itself, mediapipe complains of being deleted then.
        self._closing = weakref.finalize(self, self._model.close)
        self._first_ns: int | None = None
        self._ms, self._someone_ms = 0, 0

    @property
    def body_parts(self) -> Sequence[str]:
        """left_hand, right_hand, head: the person's own left and right."""
        return BODY_PARTS

    @property
    def complaint(self) -> str:
        """What to do when for `PATIENCE_S` nobody was made out; "" when all is well."""
        return COMPLAINT if self._ms - self._someone_ms > 1000 * PATIENCE_S else ""

    def update(self, frame: Frame) -> Tracks:
        """Centres (3, 2) px of the most prominent person, NaN for a part not seen; BadInput for what is no picture."""
        picture = _checked(frame.content)
        self._ms = self._after(frame.at_ns)
        rgb = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)
        found = self._model.landmarks(rgb, self._ms)
        if found is None:
            return Tracks(np.full((len(BODY_PARTS), 2), np.nan))
        self._someone_ms = self._ms
        height, width = picture.shape[:2]
        return read_pose(found, (width, height), self._hand)

    def close(self) -> None:
        """Give back the model's threads; no picture after it."""
        self._closing()

    def _after(self, at_ns: int) -> int:
        """Milliseconds from the first frame on, always more than before: the model refuses a clock that stands."""
        if self._first_ns is None:
            self._first_ns = at_ns
        return max(self._ms + 1, 1 + round((at_ns - self._first_ns) / 1e6))


def read_pose(landmarks: Floats, size_px: tuple[int, int], hand: Hand = "palm") -> Tracks:
    """(33, 3) u and v as shares of size_px = (width, height), visibility 0 to 1 -> Tracks in px.

    A part's centre and visibility are the means over its landmarks. From `SEEN` on it is seen, from `UNSURE` on
    guessed, below it is missing; outside the picture it is missing whatever the model says of it.
    """
    left = LEFT_HAND[hand]
    parts = (left, tuple(n + 1 for n in left), HEAD)
    means = np.array([landmarks[list(part)].mean(axis=0) for part in parts])
    inside = ((means[:, :2] >= 0) & (means[:, :2] < 1)).all(axis=1)
    sure = np.where(inside, means[:, 2], 0.0)
    centres = means[:, :2] * np.array(size_px, dtype=np.float64)
    return Tracks(_where(sure >= SEEN, centres), _where((sure >= UNSURE) & (sure < SEEN), centres))


def _where(chosen: NDArray[np.bool_], centres: Floats) -> Floats:
    result: Floats = np.where(chosen[:, None], centres, np.nan)
    return result


def _checked(content: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if content.ndim != 3 or content.shape[2] != 3 or content.dtype != np.uint8 or 0 in content.shape:
        raise BadInput(
            f"picture {content.shape} of {content.dtype}: (H, W, 3) of uint8 in the order blue, green, red is expected"
        )
    return content
