"""A folder with recorded motion and models, which end-to-end tests share."""

import shutil

import pytest
from e2e_stage import MOVEMENTS, PERFORMED, VIEWS
from once import made_once

from common.config import MeshConfig
from common.link import Link
from labanmesh import main
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from studies.performer import perform, perform_continuously


@pytest.fixture(scope="session")
def stage(tmp_path_factory):
    """A folder with motion of person 1 (motion.npz), and for each view a model that was learned from the others."""
    place = tmp_path_factory.mktemp("stage")
    shutil.copytree(made_once(tmp_path_factory, "learned", learn), place, dirs_exist_ok=True)
    # A user's folder may hold a module of their own that is named like one of ours.
    (place / "common").mkdir()
    (place / "common" / "__init__.py").write_text('raise SystemExit("imported from the current folder")\n')
    return place


def learn(folder):
    """Fill the folder with the motion and the models."""
    learned = perform(people=("2", "3"), movements=MOVEMENTS, trials=2)
    write_archive(folder / "learned.npz", learned)
    write_archive(folder / "motion.npz", MotionArchive(learned.body_parts, (perform_continuously("1", PERFORMED),)))
    for observer, view in VIEWS.items():
        paths = [str(folder / "learned.npz"), "-o", str(folder / f"{observer}.model")]
        assert main(["learn", *paths, "--view", view]) == 0


@pytest.fixture
def meeting():
    """A link where processes meet."""
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as link:
        yield link
