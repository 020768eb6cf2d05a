"""What the tests of the observer process share."""

from dataclasses import replace

import pytest
from performances import DOOR

from common.vocabulary import Vocabulary
from observer.learning.learn import learn_view
from observer.model.model_file import write_model
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from studies.performer import perform


@pytest.fixture(scope="session")
def place(tmp_path_factory):
    """A folder with recorded motion, its first four frames, and the model of the view "door" as cam1.model."""
    folder, motion = tmp_path_factory.mktemp("learned"), perform(("2",), ("lunging", "byebye"), trials=2)
    short = replace(motion.recordings[0], positions=motion.recordings[0].positions[:4])
    write_archive(folder / "motion.npz", motion)
    write_archive(folder / "short.npz", MotionArchive(motion.body_parts, (short,)))
    write_model(folder / "cam1.model", learn_view(motion, DOOR, Vocabulary(("lunging", "byebye")), kind="phase"))
    return folder
