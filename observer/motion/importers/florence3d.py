"""Imports Florence 3D Actions: a folder with skeletal_data.mat and action_names.mat, 15 joints a frame.

Source: Seidenari, Varano, Berretti, Del Bimbo, Pala, Recognizing actions from depth cameras as weakly aligned
multi-part bag-of-poses, CVPR workshops 2013. The rows of a joint are x, depth, up, in metres; wrists stand for hands,
ankles for feet.
"""

import os
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput, LabanmeshError
from observer.motion.archive import LARGEST, MotionArchive, Recording, check_recording, clean_label
from observer.motion.importers.base import ImportResult, Progress, counted
from observer.tracks import WHOLE_BODY

FLORENCE_HZ = 10.0
"""Not stated in the data; about 10 frames per second were recorded."""

_DATA, _NAMES = "skeletal_data.mat", "action_names.mat"
_SUBJECTS, _JOINTS = 10, 15
FLORENCE_PARTS = (*(part for part in WHOLE_BODY if part != "pelvis"), "spine")
"""All joints; there is none between the hips."""
_FLORENCE_ROWS = (5, 8, 0, 4, 7, 3, 6, 1, 9, 12, 10, 13, 11, 14, 2)
"""The row of each part in a clip, from 0."""
_AXES = (0, 2, 1)
"""x, up, depth: the archive's order."""


def import_folder(path: Path, progress: Progress | None = None) -> ImportResult:
    """The clips in the folder `path` (or the skeletal_data.mat itself); trials count up within subject and movement.

    Raises BadInput for a missing or broken file, naming the clip (counted from 1); LabanmeshError without scipy.
    """
    folder = path.parent if path.name == _DATA else path
    if not os.path.isdir(folder):  # noqa: PTH112 - False, not OSError, for a name that cannot be one
        raise BadInput(f"{path}: is not a folder; one that holds {_DATA} and {_NAMES} is expected")
    labels = _labels(folder / _NAMES)
    clips = _variable(folder / _DATA, "skeletal_data")
    trials: Counter[tuple[str, str]] = Counter()
    recordings = []
    for number, clip in enumerate(counted(clips, len(clips), progress), 1):
        place = f"{folder / _DATA}: clip {number}"
        label = labels[_number(clip, "action", len(labels), place) - 1]
        subject = str(_number(clip, "subject", _SUBJECTS, place))
        trials[label, subject] += 1
        recording = Recording(_positions(clip, place), FLORENCE_HZ, label, subject, str(trials[label, subject]))
        check_recording(recording, len(FLORENCE_PARTS), place)
        recordings.append(recording)
    note = f"took {FLORENCE_HZ:.0f} Hz as the sampling rate, which is not stated in the data"
    return ImportResult(MotionArchive(FLORENCE_PARTS, tuple(recordings)), (note,))


def _labels(file: Path) -> tuple[str, ...]:
    """The movements in the order of their numbers."""
    labels = tuple(clean_label(str(name)) for name in _variable(file, "action_names"))
    if not labels or not all(labels) or len(set(labels)) < len(labels):
        raise BadInput(f"{file}: action_names = {', '.join(labels)[:80]}: different names of movements are expected")
    return labels


def _variable(file: Path, name: str) -> NDArray[np.object_]:
    """The MATLAB variable `name` in `file`, flat."""
    try:
        from scipy.io import loadmat
    except ImportError:
        raise LabanmeshError("florence3d needs scipy to read MATLAB files: pip install 'labanmesh[observer]'") from None
    if not file.is_file():
        raise BadInput(f"{file}: no such file; {_DATA} and {_NAMES} are expected in this folder")
    try:
        variables = loadmat(str(file), simplify_cells=True)
    # scipy's errors for broken files have no common base class.
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise BadInput(f"{file}: cannot be read ({reason}); a MATLAB 5 file is expected") from error
    if name not in variables:
        raise BadInput(f"{file}: variable {name} is missing; Florence 3D Actions is expected")
    return np.asarray(variables[name], dtype=object).ravel()


def _field(clip: object, name: str, place: str) -> object:
    if not isinstance(clip, dict) or name not in clip:
        raise BadInput(f"{place}: field {name} is missing; original_skeletal_data, subject and action are expected")
    return clip[name]


def _number(clip: object, name: str, most: int, place: str) -> int:
    """The field `name` of a clip, a whole number from 1 to `most`."""
    number = _field(clip, name, place)
    if not isinstance(number, int | np.integer) or not 1 <= number <= most:
        shown = " ".join(repr(number).split())[:40]
        raise BadInput(f"{place}: {name} {shown}: a whole number from 1 to {most} is expected")
    return int(number)


def _positions(clip: object, place: str) -> NDArray[np.float32]:
    """(F, 15, 3) positions of the body parts."""
    joints = np.asarray(_field(clip, "original_skeletal_data", place))
    if joints.ndim != 3 or joints.shape[:2] != (3, _JOINTS) or joints.dtype.kind != "f":
        raise BadInput(
            f"{place}: positions are {joints.dtype} {joints.shape}: numbers (3, {_JOINTS}, frames) are expected"
        )
    positions = joints[_AXES, :, :][:, _FLORENCE_ROWS, :].transpose(2, 1, 0)
    sound = (np.abs(positions) <= LARGEST).all(axis=(1, 2))
    if not sound.all():
        raise BadInput(f"{place}: frame {int(sound.argmin())}: a position is not finite; metres are expected")
    return np.asarray(positions, np.float32)
