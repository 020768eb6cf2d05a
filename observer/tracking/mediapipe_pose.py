"""MediaPipe's pose model as a tracker.

Up to 0.10.21 its wheel carries the model, with `mediapipe.solutions`; from 0.10.30 on there is only `mediapipe.tasks`,
which needs a .task file. Nothing is ever downloaded: of the wheel only the model of complexity 1 is used, because it
lacks those of 0 and 2.

The model of a .task file gets a square of the picture that stays in place while the person is inside: a model that
remembers its last picture sees no jump. When the square moves, the model is made to forget.
"""

import importlib
import logging
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.config_people import MOST_PEOPLE
from common.errors import BadInput, LabanmeshError
from common.tflite import task_without_outline
from common.tracker_choice import INSTALL_MEDIAPIPE
from observer.tracking.people import CLEARLY_SEEN, HIPS, SHOULDERS, Body, FollowRule, PersonModel, Pose, Rgb, SearchArea
from observer.tracking.person_follower import PersonFollower
from observer.tracking.pose import Hand, PoseModel, PoseTracker, require_hand, stderr_silenced
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


ROOM = 2.0
"""Side of the square, of the person's height."""
WHOLE = 0.75
"""Share of the picture's short side from which the whole picture is used instead."""
TALL_TORSOS = 3.4
"""A standing person's height, of the distance from the hips to the shoulders."""
FAINT = 0.2
"""Visibility below which a landmark does not count for the person's place."""


class CroppedPeople:
    """A `PersonModel` of a `PoseModel`. Two more methods of the model are used where it has them: `everybody` gives the
    landmarks (33, 3) of each person in a picture; `forget(ms)` makes a model that remembers the last picture forget it.
    """

    def __init__(self, model: PoseModel) -> None:
        self._model = model
        self._area: SearchArea | None = None
        self._ms = 0

    def find(self, rgb: Rgb, area: SearchArea, ms: int) -> Sequence[Body]:
        """As `PersonModel.find`."""
        everybody = getattr(self._model, "everybody", None)
        if everybody is not None:
            people = everybody(area.cut(rgb))
        else:
            landmarks = self._run(rgb, area, ms)
            people = [] if landmarks is None else [landmarks]
        return [body_of(_in_picture(each, area, rgb), (rgb.shape[1], rgb.shape[0])) for each in people]

    def pose(self, rgb: Rgb, body: Body, ms: int) -> Pose | None:
        """As `PersonModel.pose`."""
        height, width = rgb.shape[:2]
        area = self._area
        if area is None or not _holds(area, body, (width, height)):
            area = square_about(body, (width, height))
        landmarks = self._run(rgb, area, ms)
        if landmarks is None:
            return None
        landmarks = _in_picture(landmarks, area, rgb)
        return Pose(landmarks, body_of(landmarks, (width, height)))

    def restart(self) -> None:
        """As `PersonModel.restart`."""
        self._area = None

    def close(self) -> None:
        """As `PersonModel.close`."""
        self._model.close()

    def _run(self, rgb: Rgb, area: SearchArea, ms: int) -> Floats | None:
        """The landmarks as shares of the area; the model sees times that increase."""
        forget = getattr(self._model, "forget", None)
        if area != self._area and forget is not None:
            forget(self._later(ms))
        self._area = area
        return self._model.landmarks(area.cut(rgb), self._later(ms))

    def _later(self, ms: int) -> int:
        self._ms = max(self._ms + 1, ms)
        return self._ms


def square_about(body: Body, size: tuple[int, int]) -> SearchArea:
    """The square for a person, moved into a picture of size (width, height); the whole picture for a large person."""
    side = round(body.height * ROOM)
    if side * WHOLE >= min(size) or body.height >= WHOLE * min(size):
        return SearchArea(0, 0, *size)
    side = min(side, *size)
    left, top = (round(min(max(c - side / 2, 0), most - side)) for c, most in zip((body.u, body.v), size, strict=True))
    return SearchArea(left, top, side, side)


def _holds(area: SearchArea, body: Body, size: tuple[int, int]) -> bool:
    """Whether the person is well inside the area, and neither too small nor too large for it."""
    if (area.width, area.height) == size:
        return square_about(replace(body, height=body.height * 1.2), size) == area
    share = body.height / area.width
    margin = body.height / 2
    inside = all(
        (low <= 0 or c - low >= margin) and (low + length >= most or low + length - c >= margin)
        for c, low, length, most in (
            (body.u, area.left, area.width, size[0]),
            (body.v, area.top, area.height, size[1]),
        )
    )
    return inside and 0.6 / ROOM <= share <= 1.5 / ROOM


def body_of(landmarks: Floats, size: tuple[int, int]) -> Body:
    """Where landmarks (33, 3), as shares of a picture of that size, say that a person is.

    The height is the greatest of what the torso, the shoulders and the landmarks that are seen say.
    """
    px = landmarks[:, :2] * np.array(size, dtype=np.float64)
    clear = landmarks[:, 2] >= CLEARLY_SEEN
    if clear.sum() < 2:
        clear = landmarks[:, 2] >= FAINT
    if clear.sum() < 2:
        clear = np.ones(len(landmarks), np.bool_)
    extent = np.ptp(px[clear], axis=0)
    shoulders, hips = px[list(SHOULDERS)], px[list(HIPS)]
    known = bool((landmarks[[*SHOULDERS, *HIPS], 2] >= FAINT).all())
    torso = float(np.linalg.norm(shoulders.mean(axis=0) - hips.mean(axis=0))) if known else 0.0
    across = float(np.linalg.norm(shoulders[0] - shoulders[1]))
    u, v = hips.mean(axis=0) if known else px[clear].mean(axis=0)
    return Body(float(u), float(v), max(float(extent.max()), TALL_TORSOS * torso, TALL_TORSOS * across, 1.0))


def _in_picture(landmarks: Floats, area: SearchArea, rgb: Rgb) -> Floats:
    """Shares of the area -> shares of the whole picture."""
    height, width = rgb.shape[:2]
    shares = landmarks.copy()
    shares[:, 0] = (area.left + landmarks[:, 0] * area.width) / width
    shares[:, 1] = (area.top + landmarks[:, 1] * area.height) / height
    return shares
