"""MediaPipe's pose model, in whichever way the installed version offers it: a picture becomes 33 landmarks.

Up to 0.10.21 `mediapipe.solutions` carries the model in its wheel; from 0.10.30 on there is only `mediapipe.tasks`,
whose model is a .task file of the user's. Nothing is ever downloaded: of the old solution only complexity 1 is used,
because it fetches the models of 0 and 2 when asked for them.
"""

import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput, LabanmeshError
from observer.tracks import Floats

LANDMARKS = 33
"""BlazePose's points (Bazarevsky et al., BlazePose: on-device real-time body pose tracking, 2020, figure 3)."""

INSTALL = "pip install 'labanmesh[mediapipe]'"
LIBRARIES = "if it names a system library, install that (Debian: libgl1, libegl1, libgles2)"


class PoseModel(Protocol):
    """Finds the landmarks of the most prominent person; follows him from picture to picture."""

    def landmarks(self, rgb: NDArray[np.uint8], ms: int) -> Floats | None:
        """(H, W, 3) picture, red first -> (33, 3) u and v as shares of width and height, visibility 0 to 1; or nobody.

        ms: milliseconds, more than those of the picture before.
        """

    def close(self) -> None:
        """Give back its threads; no picture after it."""


def open_pose(model_path: str | None) -> PoseModel:
    """The model in the file `model_path`, or for None the one that the installed mediapipe carries.

    Raises BadInput without mediapipe, for a mediapipe that carries none, and for a file that is no pose model;
    LabanmeshError where a library of the system is missing.
    """
    # Must be set before the first import, and is a person's own where he set it.
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
    """The model inside the wheel. It takes pictures to be 1/30 s apart, which only its smoothing of landmarks sees."""

    def __init__(self, solution: Any) -> None:  # noqa: ANN401 - mediapipe has no types
        with _hushed():
            self._pose = solution.Pose(model_complexity=1)
            self._pose.process(_nothing())

    def landmarks(self, rgb: NDArray[np.uint8], ms: int) -> Floats | None:
        """As `PoseModel.landmarks`; `ms` is not read."""
        found = self._pose.process(rgb).pose_landmarks
        return None if found is None else _array(found.landmark)

    def close(self) -> None:
        """As `PoseModel.close`."""
        self._pose.close()


class TaskPose:
    """A model in a .task file, by `mediapipe.tasks`. Raises BadInput where the file is missing or no pose model."""

    def __init__(self, model_path: str) -> None:
        if not Path(model_path).is_file():
            raise BadInput(f"pose_model = {model_path!r}: no such file; a pose landmarker .task file is expected")
        self._mediapipe = _imported("mediapipe")
        vision = _imported("mediapipe.tasks.python.vision")
        base = _imported("mediapipe.tasks.python").BaseOptions(model_asset_path=model_path)
        options = vision.PoseLandmarkerOptions(base_options=base, running_mode=vision.RunningMode.VIDEO)
        try:
            with _hushed():
                self._pose = vision.PoseLandmarker.create_from_options(options)
                self._detect(_nothing(), 0)
        # What it raises over a file that is no model differs from version to version.
        except (RuntimeError, ValueError, FileNotFoundError) as error:
            reason = _one_line(error).rstrip(".")
            raise BadInput(f"pose_model = {model_path!r}: {reason}; a pose landmarker .task file is expected") from None
        except OSError as error:
            raise LabanmeshError(f"mediapipe cannot start: {_one_line(error)}; {LIBRARIES}") from None

    def landmarks(self, rgb: NDArray[np.uint8], ms: int) -> Floats | None:
        """As `PoseModel.landmarks`; `ms` must be above 0."""
        found = self._detect(rgb, ms).pose_landmarks
        return _array(found[0]) if found else None

    def close(self) -> None:
        """As `PoseModel.close`."""
        try:
            self._pose.close()
        except RuntimeError:
            # Python is ending and has stopped the threads that mediapipe 1 closes with; without its handle it does not
            # try again, and loudly, while it is deleted.
            self._pose._handle = None

    def _detect(self, rgb: NDArray[np.uint8], ms: int) -> Any:  # noqa: ANN401 - mediapipe has no types
        image = self._mediapipe.Image(image_format=self._mediapipe.ImageFormat.SRGB, data=rgb)
        return self._pose.detect_for_video(image, ms)


def _imported(name: str) -> Any:  # noqa: ANN401 - mediapipe has no types
    """Late, because it costs a second and most observers do without it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        if error.name == "mediapipe":
            raise BadInput(f"the tracker 'mediapipe' needs mediapipe, which is not installed: {INSTALL}") from None
        raise LabanmeshError(f"{name} cannot be imported: {_one_line(error)}; {LIBRARIES}, or {INSTALL}") from None


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:160]


def _array(found: Any) -> Floats:  # noqa: ANN401 - mediapipe has no types
    return np.array([[mark.x, mark.y, mark.visibility] for mark in found], dtype=np.float64)


def _nothing() -> NDArray[np.uint8]:
    """A picture without a person: the first picture starts the model, which then says all that it has to say."""
    return np.zeros((64, 64, 3), dtype=np.uint8)


@contextmanager
def _hushed() -> Iterator[None]:
    """Without what the native code writes while it starts: warnings about its own model, which no setting silences."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
