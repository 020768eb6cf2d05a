"""Imports MSR Action3D: a folder of aAA_sSS_eEE_skeleton3D.txt files, 20 joints a frame, 15 frames a second.

Source: Li, Zhang, Liu, Action recognition based on a bag of 3D points, CVPR workshops 2010. The joints are in metres,
x to the performer's right, y up, z away from the camera, which the performer faces: the archive's own axes.
"""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording, check_recording
from observer.motion.importers.base import ImportResult, Progress, counted, files_at, number_rows, read_text
from observer.motion.label_sets import MSR_LABELS
from observer.tracks import WHOLE_BODY

MSR_HZ = 15.0
MOST_EMPTY = 0.3
"""Sequences with a larger share of empty (all-zero) frames are left out: 553 of the 567 remain."""

_FILE_SUFFIX = "_skeleton3D.txt"
_FILE_NAME = re.compile(r"a(\d\d)_s(\d\d)_e(\d\d)" + re.escape(_FILE_SUFFIX))
_WHAT = "files named like a01_s01_e01" + _FILE_SUFFIX
_SUBJECTS, _TRIALS, _JOINTS = 10, 3, 20
MSR_PARTS = (*WHOLE_BODY, "spine", "left_wrist", "right_wrist", "left_ankle", "right_ankle")
"""All joints; the wrists and ankles are beside the hands and feet."""
_MSR_ROWS = (11, 12, 19, 7, 8, 0, 1, 2, 6, 4, 5, 13, 14, 17, 18, 3, 9, 10, 15, 16)
"""The row of each part in a frame, from 0."""


def import_folder(path: Path, progress: Progress | None = None) -> ImportResult:
    """The sequences in the folder `path` or in folders just below it; each empty frame becomes "not seen".

    Sequences with more than 30 % empty frames are left out, and named in the notes. Raises BadInput for a file
    with a wrong name, a row that is not four finite numbers, or frames that are not whole.
    """
    files = files_at(path, f"*{_FILE_SUFFIX}", _WHAT)
    recordings: list[Recording] = []
    notes: list[str] = []
    paths: dict[str, Path] = {}
    for file in counted(files, len(files), progress):
        if paths.setdefault(file.name, file) != file:
            raise BadInput(f"{file}: the same sequence as {paths[file.name]}; each is expected once")
        name = _named(file)
        positions, empty = _positions(file)
        if empty > MOST_EMPTY:
            sequence = file.name.removesuffix(_FILE_SUFFIX)
            notes.append(f"left out {sequence}: {100 * empty:.0f} % of its frames are empty")
        else:
            recording = Recording(positions, MSR_HZ, *name)
            check_recording(recording, len(MSR_PARTS), str(file))
            recordings.append(recording)
    if not recordings:
        raise BadInput(f"{path}: nothing remains: more than {100 * MOST_EMPTY:.0f} % of every sequence is empty frames")
    return ImportResult(MotionArchive(MSR_PARTS, tuple(recordings)), tuple(notes))


def _named(file: Path) -> tuple[str, str, str]:
    """Label, subject and trial of a sequence, from its file's name."""
    match = _FILE_NAME.fullmatch(file.name)
    if match is None:
        raise BadInput(f"{file}: the name of a sequence is expected, such as a01_s01_e01{_FILE_SUFFIX}")
    action, subject, trial = map(int, match.groups())
    for what, number, most in (
        ("action", action, len(MSR_LABELS)),
        ("subject", subject, _SUBJECTS),
        ("trial", trial, _TRIALS),
    ):
        if not 1 <= number <= most:
            raise BadInput(f"{file}: {what} {number} in its name; 1 to {most} is expected")
    return MSR_LABELS[action - 1], str(subject), str(trial)


def _positions(file: Path) -> tuple[NDArray[np.float32], float]:
    """(F, 20, 3) positions of the body parts, NaN in empty frames, and the share of empty frames."""
    lines = read_text(file).rstrip().splitlines()
    rows = number_rows(file, lines, 4)
    if len(rows) % _JOINTS:
        raise BadInput(
            f"{file}: line {len(rows)}: ends within frame {len(rows) // _JOINTS}; {_JOINTS} lines a frame are expected"
        )
    joints = rows.reshape(-1, _JOINTS, 4)[:, :, :3]
    # The recorder wrote zeros for all joints while it had lost the person.
    empty = (joints == 0).all(axis=(1, 2))
    positions = joints[:, _MSR_ROWS].astype(np.float32)
    positions[empty] = np.nan
    return positions, float(empty.mean())
