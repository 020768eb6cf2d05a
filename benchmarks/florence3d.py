"""Florence 3D Actions as a motion archive: a folder with skeletal_data.mat and action_names.mat, 15 joints a frame.

    python -m benchmarks.florence3d FOLDER florence.npz

Source: Seidenari, Varano, Berretti, Del Bimbo, Pala, Recognizing actions from depth cameras as weakly aligned
multi-part bag-of-poses, CVPR workshops 2013. The rows of a joint are x, depth, up, in metres; wrists stand for hands,
ankles for feet.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from observer.motion.archive import MotionArchive, Recording, clean_label
from observer.motion.archive_file import write_archive
from observer.tracks import WHOLE_BODY

FLORENCE_HZ = 10.0
"""Not stated in the data; about 10 frames per second were recorded."""
FLORENCE_PARTS = (*(part for part in WHOLE_BODY if part != "pelvis"), "spine")
"""All joints; there is none between the hips."""
FLORENCE_ROWS = (5, 8, 0, 4, 7, 3, 6, 1, 9, 12, 10, 13, 11, 14, 2)
"""The row of each part in a clip, from 0."""
AXES = (0, 2, 1)
"""x, up, depth: the archive's order."""


def read_florence3d(folder: Path) -> MotionArchive:
    """The clips in the folder; trials count up within subject and movement."""
    labels = [clean_label(str(name)) for name in _variable(folder / "action_names.mat", "action_names")]
    trials: Counter[tuple[str, str]] = Counter()
    recordings = []
    for clip in _variable(folder / "skeletal_data.mat", "skeletal_data"):
        label, subject = labels[int(clip["action"]) - 1], str(clip["subject"])
        trials[label, subject] += 1
        positions = np.asarray(clip["original_skeletal_data"], np.float32)[AXES, :, :][:, FLORENCE_ROWS, :]
        trial = str(trials[label, subject])
        recordings.append(Recording(positions.transpose(2, 1, 0).copy(), FLORENCE_HZ, label, subject, trial))
    return MotionArchive(FLORENCE_PARTS, tuple(recordings))


def _variable(file: Path, name: str) -> NDArray[np.object_]:
    """The MATLAB variable `name` in `file`, flat."""
    return np.asarray(loadmat(str(file), simplify_cells=True)[name], dtype=object).ravel()


if __name__ == "__main__":
    write_archive(Path(sys.argv[2]), read_florence3d(Path(sys.argv[1])))
