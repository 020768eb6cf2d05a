"""MediaPipe's pose model as a tracker.

Up to 0.10.21 `mediapipe.solutions` carries the model in its wheel; from 0.10.30 on there is only `mediapipe.tasks`,
which needs a .task file. Nothing is ever downloaded: of the solution only complexity 1 is used, because it fetches the
models of 0 and 2.
"""

import importlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput, LabanmeshError
from common.tracker_choice import INSTALL_MEDIAPIPE
from observer.tracking.pose import Hand, PoseModel, PoseTracker, require_hand, stderr_silenced
from observer.tracks import BODY_PARTS, Floats

LIBRARIES = "if it names a system library, install that (Debian: libgl1, libegl1, libgles2)"


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
    try:
        return SolutionPose(mediapipe.solutions.pose)
    except (AttributeError, OSError, RuntimeError, ValueError) as error:
        raise LabanmeshError(f"mediapipe cannot start: {_one_line(error)}; {LIBRARIES}") from None


class SolutionPose:
    """The model inside the wheel. It assumes pictures 1/30 s apart, which affects only its smoothing."""

    def __init__(self, solution: Any) -> None:  # noqa: ANN401 - mediapipe has no types
        with stderr_silenced():
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
            with stderr_silenced():
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
            way_out = INSTALL_MEDIAPIPE
            raise BadInput(f"the tracker 'mediapipe' needs mediapipe, which is not installed: {way_out}") from None
        fault = _one_line(error)
    except (AttributeError, OSError, RuntimeError, TypeError, ValueError) as error:
        # A numpy or protobuf of another version.
        fault = _one_line(error)
    raise LabanmeshError(f"{name} cannot be imported: {fault}; {LIBRARIES}, or {INSTALL_MEDIAPIPE}")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:160]


def _array(landmarks: Any) -> Floats:  # noqa: ANN401 - mediapipe has no types
    return np.array([[mark.x, mark.y, mark.visibility] for mark in landmarks], dtype=np.float64)


def _empty_picture() -> NDArray[np.uint8]:
    """A picture without a person: the first picture starts the model, which then prints its warnings."""
    return np.zeros((64, 64, 3), dtype=np.uint8)


class MediapipeTracker(PoseTracker):
    """`PoseTracker` with MediaPipe's model.

    model_path: a pose landmarker .task file, or None for the model in mediapipe's wheel. Raises BadInput without
    mediapipe, without a model, and as `PoseTracker` does.
    """

    def __init__(
        self, model_path: str | None = None, hand: Hand = "palm", body_parts: Sequence[str] = BODY_PARTS
    ) -> None:
        require_hand(hand)
        super().__init__(open_pose(model_path), "mediapipe", hand, body_parts)
