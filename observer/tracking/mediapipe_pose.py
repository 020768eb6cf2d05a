"""MediaPipe's pose model as a tracker: 33 landmarks become hands and head.

Up to 0.10.21 `mediapipe.solutions` carries the model in its wheel; from 0.10.30 on there is only `mediapipe.tasks`,
which needs a .task file. Nothing is ever downloaded: of the solution only complexity 1 is used, because it fetches the
models of 0 and 2.
"""

import importlib
import os
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput, LabanmeshError
from observer.camera.base import require_picture
from observer.tracks import BODY_PARTS, Floats, Frame, Tracks

LANDMARKS = 33
"""Landmarks of BlazePose (Bazarevsky et al., BlazePose: on-device real-time body pose tracking, 2020, figure 3)."""
INSTALL = "pip install 'labanmesh[mediapipe]'"
LIBRARIES = "if it names a system library, install that (Debian: libgl1, libegl1, libgles2)"


class PoseModel(Protocol):
    """Finds the landmarks of the most prominent person and follows them from picture to picture."""

    def landmarks(self, rgb: NDArray[np.uint8], ms: int) -> Floats | None:
        """(H, W, 3) RGB -> (33, 3) u and v as shares of width and height, visibility 0 to 1; None without a person.

        ms: time of the picture, greater than that of the previous one.
        """

    def close(self) -> None:
        """Release the threads of the model; no picture may follow."""


def open_pose(model_path: str | None) -> PoseModel:
    """The model in the file `model_path`, or for None the model in the installed mediapipe.

    Raises BadInput without mediapipe, for a mediapipe without a model, and for a file that is not a pose model;
    LabanmeshError when a system library is missing.
    """
    # Must be set before the first import; a value set by the user stays.
    os.environ.setdefault("GLOG_minloglevel", "2")
    mediapipe = _imported("mediapipe")
    if model_path is not None:
        return TaskPose(model_path)
    if not hasattr(mediapipe, "solutions"):
        version = getattr(mediapipe, "__version__", "this version")
        raise BadInput(
            f"mediapipe {version} carries no pose model: name a pose landmarker .task file (pose_model), or install"
            " mediapipe 0.10.21, which carries one (Python 3.11 or 3.12)"
        )
    return SolutionPose(mediapipe.solutions.pose)


class SolutionPose:
    """The model inside the wheel. It assumes pictures 1/30 s apart, which affects only its smoothing."""

    def __init__(self, solution: Any) -> None:  # noqa: ANN401 - mediapipe has no types
        with _stderr_silenced():
            self._pose = solution.Pose(model_complexity=1)
            self._pose.process(_empty_picture())

    def landmarks(self, rgb: NDArray[np.uint8], ms: int) -> Floats | None:
        """As `PoseModel.landmarks`; `ms` is ignored."""
        landmarks = self._pose.process(rgb).pose_landmarks
        return None if landmarks is None else _array(landmarks.landmark)

    def close(self) -> None:
        """As `PoseModel.close`."""
        self._pose.close()


class TaskPose:
    """A model in a .task file, run by `mediapipe.tasks`. Raises BadInput for a missing file and for another file."""

    def __init__(self, model_path: str) -> None:
        if not Path(model_path).is_file():
            raise BadInput(f"pose_model = {model_path!r}: no such file; a pose landmarker .task file is expected")
        self._mediapipe = _imported("mediapipe")
        vision = _imported("mediapipe.tasks.python.vision")
        base = _imported("mediapipe.tasks.python").BaseOptions(model_asset_path=model_path)
        options = vision.PoseLandmarkerOptions(base_options=base, running_mode=vision.RunningMode.VIDEO)
        try:
            with _stderr_silenced():
                self._pose = vision.PoseLandmarker.create_from_options(options)
                self._detect(_empty_picture(), 0)
        # The exception for a file that is not a model differs between versions.
        except (RuntimeError, ValueError, FileNotFoundError) as error:
            reason = _one_line(error).rstrip(".")
            raise BadInput(f"pose_model = {model_path!r}: {reason}; a pose landmarker .task file is expected") from None
        except OSError as error:
            raise LabanmeshError(f"mediapipe cannot start: {_one_line(error)}; {LIBRARIES}") from None

    def landmarks(self, rgb: NDArray[np.uint8], ms: int) -> Floats | None:
        """As `PoseModel.landmarks`; `ms` must be above 0."""
        people = self._detect(rgb, ms).pose_landmarks
        return _array(people[0]) if people else None

    def close(self) -> None:
        """As `PoseModel.close`."""
        try:
            self._pose.close()
        except RuntimeError:
            # At exit Python has already stopped the threads that mediapipe 1 needs to close. Without its handle it does
            # not try again, with a traceback, when it is deleted.
            self._pose._handle = None

    def _detect(self, rgb: NDArray[np.uint8], ms: int) -> Any:  # noqa: ANN401 - mediapipe has no types
        image = self._mediapipe.Image(image_format=self._mediapipe.ImageFormat.SRGB, data=rgb)
        return self._pose.detect_for_video(image, ms)


def _imported(name: str) -> Any:  # noqa: ANN401 - mediapipe has no types
    """Import on first use: it takes a second, and most observers do not need it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        if error.name == "mediapipe":
            raise BadInput(f"the tracker 'mediapipe' needs mediapipe, which is not installed: {INSTALL}") from None
        raise LabanmeshError(f"{name} cannot be imported: {_one_line(error)}; {LIBRARIES}, or {INSTALL}") from None


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:160]


def _array(landmarks: Any) -> Floats:  # noqa: ANN401 - mediapipe has no types
    return np.array([[mark.x, mark.y, mark.visibility] for mark in landmarks], dtype=np.float64)


def _empty_picture() -> NDArray[np.uint8]:
    """A picture without a person: the first picture starts the model, which then prints its warnings."""
    return np.zeros((64, 64, 3), dtype=np.uint8)


@contextmanager
def _stderr_silenced() -> Iterator[None]:
    """Drop the start-up warnings of the native code about its own model, which no setting silences."""
    stderr, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(null)


Hand = Literal["palm", "wrist"]

LEFT_HAND: Mapping[Hand, tuple[int, ...]] = {"palm": (15, 17, 19), "wrist": (15,)}
"""Landmarks whose mean is the left hand: wrist, and the knuckles of little and index finger; those of the right hand
have the next number. Depth cameras report the palm, even in recordings that call it wrist."""
HEAD = (7, 8)
"""Both ears: their midpoint is the middle of the head from all sides, as in recordings of depth cameras."""
SEEN = 0.5
"""Visibility from which a part is seen: MediaPipe's own threshold for its confidences."""
UNSURE = 0.2
"""Visibility from which the model's position of a hidden part is shown as a guess."""
NOBODY_S = 2.0
"""Time without a person before a complaint; people turn, stoop and pass behind things."""
COMPLAINT = (
    "the tracker mediapipe finds nobody: the picture must show a person at least from head to hips, in good light;"
    " for face and hands alone use the tracker camshift"
)


class MediapipeTracker:
    """A `Tracker` of pictures (H, W, 3) uint8 BGR; centres in px of the picture.

    model_path: a pose landmarker .task file, or None for the model in mediapipe's wheel. hand: the centre of a hand is
    the middle of the palm or the wrist. Mirrored pictures exchange left and right. Raises BadInput without mediapipe,
    without a model, and for an unknown hand.
    """

    def __init__(self, model_path: str | None = None, hand: Hand = "palm") -> None:
        if hand not in LEFT_HAND:
            raise BadInput(f"hand = {hand!r}: unknown; known: {', '.join(LEFT_HAND)}")
        self._hand = hand
        self._model = open_pose(model_path)
        # At the latest at exit: mediapipe prints a traceback when it is deleted while open.
        self._closing = weakref.finalize(self, self._model.close)
        self._first_ns: int | None = None
        self._ms, self._someone_ms = 0, 0

    @property
    def body_parts(self) -> Sequence[str]:
        """left_hand, right_hand, head: left and right of the person."""
        return BODY_PARTS

    @property
    def complaint(self) -> str:
        """What to do when nobody was found for NOBODY_S; "" when all is well."""
        return COMPLAINT if self._ms - self._someone_ms > 1000 * NOBODY_S else ""

    def update(self, frame: Frame) -> Tracks:
        """Centres (3, 2) px of the most prominent person, NaN for a part not seen; BadInput for a wrong shape."""
        picture = require_picture(frame.content)
        self._ms = self._after(frame.at_ns)
        rgb = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)
        landmarks = self._model.landmarks(rgb, self._ms)
        if landmarks is None:
            return Tracks(np.full((len(BODY_PARTS), 2), np.nan))
        self._someone_ms = self._ms
        height, width = picture.shape[:2]
        return read_pose(landmarks, (width, height), self._hand)

    def close(self) -> None:
        """Release the threads of the model; no picture may follow."""
        self._closing()

    def _after(self, at_ns: int) -> int:
        """Milliseconds since the first frame, strictly increasing: the model rejects repeated times."""
        if self._first_ns is None:
            self._first_ns = at_ns
        return max(self._ms + 1, 1 + round((at_ns - self._first_ns) / 1e6))


def read_pose(landmarks: Floats, size_px: tuple[int, int], hand: Hand = "palm") -> Tracks:
    """(33, 3) u and v as shares of size_px = (width, height), visibility 0 to 1 -> Tracks in px.

    A part's centre and visibility are the means over its landmarks. It is seen from a visibility of SEEN, a guess from
    UNSURE, else missing; outside the picture it is always missing.
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
