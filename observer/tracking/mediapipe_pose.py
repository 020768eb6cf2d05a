"""MediaPipe's pose model as a tracker.

Up to 0.10.21 its wheel carries the model, with `mediapipe.solutions`; from 0.10.30 on there is only `mediapipe.tasks`,
which needs a .task file. Nothing is ever downloaded: of the wheel only the model of complexity 1 is used, because it
lacks those of 0 and 2.
"""

import importlib
import logging
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.config_people import MOST_PEOPLE
from common.errors import BadInput, LabanmeshError
from common.tflite import task_without_outline
from common.tracker_choice import INSTALL_MEDIAPIPE
from observer.tracking.cropped_pose import CroppedPeople
from observer.tracking.people import Body, FollowRule, PersonModel, SearchArea
from observer.tracking.person_follower import PersonFollower
from observer.tracking.pose import Hand, PoseTracker, require_hand, stderr_silenced
from observer.tracking.pose_graph import GraphPeople
from observer.tracks import BODY_PARTS, Floats

log = logging.getLogger("labanmesh.observer")

LIBRARIES = "if it names a system library, install that (Debian: libgl1, libegl1, libgles2)"


def open_people(model_path: str | None, smooth: bool = True) -> PersonModel:
    """The model in the file `model_path`, or for None the model in the installed mediapipe.

    smooth: the landmarks are smoothed over time, by which they lag; those of a .task file always are.

    Raises BadInput without mediapipe, for a mediapipe without a model, and for a file that is not a pose model;
    LabanmeshError when a system library is missing.
    """
    # Must be set before the first import; a value set by the user stays.
    os.environ.setdefault("GLOG_minloglevel", "2")
    mediapipe = _imported("mediapipe")
    if model_path is not None:
        return CroppedPeople(TaskPose(model_path))
    if not hasattr(mediapipe, "solutions"):
        version = getattr(mediapipe, "__version__", "this version")
        raise BadInput(
            f"mediapipe {version} carries no pose model: name a pose landmarker .task file (pose_model), or install"
            " mediapipe 0.10.21, which carries one (Python 3.11 or 3.12)"
        )
    try:
        return _people_of_the_wheel(smooth)
    except (AttributeError, OSError, RuntimeError, ValueError) as error:
        raise LabanmeshError(f"mediapipe cannot start: {_one_line(error)}; {LIBRARIES}") from None


def _people_of_the_wheel(smooth: bool) -> PersonModel:
    with stderr_silenced():
        people = GraphPeople(smooth)
        # The first picture starts the models, which then print their warnings.
        people.find(_empty_picture(), SearchArea(0, 0, 64, 64), 0)
        people.pose(_empty_picture(), Body(32, 32, 32), 0)
    return people


class TaskPose:
    """A model in a .task file, run by `mediapipe.tasks`. Raises BadInput for a missing file and for another file."""

    def __init__(self, model_path: str) -> None:
        if not Path(model_path).is_file():
            raise BadInput(f"pose_model = {model_path!r}: no such file; a pose landmarker .task file is expected")
        try:
            task = task_without_outline(Path(model_path).read_bytes())
        except OSError as error:
            raise BadInput(f"pose_model = {model_path!r}: {_one_line(error)}") from None
        self._mediapipe = _imported("mediapipe")
        vision = _imported("mediapipe.tasks.python.vision")
        base = _imported("mediapipe.tasks.python").BaseOptions(model_asset_buffer=task)
        options = vision.PoseLandmarkerOptions(base_options=base, running_mode=vision.RunningMode.VIDEO)
        many = vision.PoseLandmarkerOptions(base_options=base, num_poses=MOST_PEOPLE)
        self._landmarker, self._many = vision.PoseLandmarker, many
        self._everybody: Any = None
        try:
            with stderr_silenced():
                self._pose = self._landmarker.create_from_options(options)
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

    def forget(self, ms: int) -> None:
        """The next picture is of another place: the model, which follows one person, finds nobody and begins anew."""
        self._detect(_empty_picture(), ms)

    def everybody(self, rgb: NDArray[np.uint8]) -> list[Floats]:
        """The landmarks (33, 3) of each person, up to MOST_PEOPLE, without regard to earlier pictures."""
        if self._everybody is None:
            with stderr_silenced():
                self._everybody = self._landmarker.create_from_options(self._many)
                self._everybody.detect(self._image(_empty_picture()))
        return [_array(person) for person in self._everybody.detect(self._image(rgb)).pose_landmarks]

    def close(self) -> None:
        """As `PoseModel.close`."""
        for landmarker in (self._pose, self._everybody):
            try:
                if landmarker is not None:
                    landmarker.close()
            except RuntimeError:
                # At exit Python has already stopped the threads that mediapipe 1 needs to close. Without its handle it
                # does not try again, with a traceback, when it is deleted.
                landmarker._handle = None

    def _detect(self, rgb: NDArray[np.uint8], ms: int) -> Any:  # noqa: ANN401 - mediapipe has no types
        return self._pose.detect_for_video(self._image(rgb), ms)

    def _image(self, rgb: NDArray[np.uint8]) -> Any:  # noqa: ANN401 - mediapipe has no types
        return self._mediapipe.Image(image_format=self._mediapipe.ImageFormat.SRGB, data=rgb)


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

    model_path: a pose landmarker .task file, or None for the model in mediapipe's wheel. rule: who is followed.
    smooth: as for `open_people`. Raises BadInput without mediapipe, without a model, and as `PoseTracker` does.
    """

    def __init__(
        self,
        model_path: str | None = None,
        hand: Hand = "palm",
        body_parts: Sequence[str] = BODY_PARTS,
        rule: FollowRule | None = None,
        smooth: bool = True,
    ) -> None:
        require_hand(hand)
        people = open_people(model_path, smooth)
        super().__init__(PersonFollower(people, rule, log.info), "mediapipe", hand, body_parts)
