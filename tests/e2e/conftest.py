"""What end-to-end tests share: our command line, and a folder with recorded motion and models."""

import subprocess
import sys

import pytest

from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from studies.performer import perform, perform_continuously

MOVEMENTS = ("lunging", "byebye", "nthrow", "stretch")
PERFORMED = ("byebye", "nthrow")
VIEWS = {"door": "door", "corner": "yaw:45", "wheel": "wheel"}


@pytest.fixture(scope="session")
def labanmesh():
    """The words of a command as a process is started with."""
    return lambda *words: [sys.executable, "-P", "-m", "labanmesh", *map(str, words)]


@pytest.fixture(scope="session")
def stage(tmp_path_factory, labanmesh):
    """A folder with motion of person 1 (motion.npz), and for each view a model that was learned from the others."""
    place = tmp_path_factory.mktemp("stage")
    # A user's folder may hold a module of their own that is named like one of ours.
    (place / "common").mkdir()
    (place / "common" / "__init__.py").write_text('raise SystemExit("imported from the current folder")\n')
    learned = perform(people=("2", "3", "4"), movements=MOVEMENTS, trials=2)
    write_archive(place / "learned.npz", learned)
    motion = MotionArchive(learned.body_parts, (perform_continuously("1", PERFORMED),))
    write_archive(place / "motion.npz", motion)
    for observer, view in VIEWS.items():
        command = labanmesh("learn", place / "learned.npz", "--view", view, "-o", place / f"{observer}.model")
        subprocess.run(command, cwd=place, check=True, capture_output=True, timeout=60)
    return place
