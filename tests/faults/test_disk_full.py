"""The disk fills while a scene is captured: one line says so, what was written stays readable, the scene goes on."""

import os
import shutil
import subprocess

import pytest
from fault_processes import SOON_S, Process, labanmesh
from fault_stage import SECOND_NS, Stage, all_count

from common.capture_file import CaptureFile

DISK_KB = 96
"""A scene of three observers fills it in about a second."""


@pytest.fixture
def small_disk(tmp_path):
    """A disk of its own, in memory, that takes almost nothing."""
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("only root can mount a small disk")
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_KB}k", "tmpfs", str(place)])
    if mounted.returncode:
        pytest.skip("no disk can be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_a_full_disk_ends_the_capture_in_one_line_and_nothing_else(replay, tmp_path, small_disk):
    with Stage(replay, tmp_path) as stage:
        capture = stage.processes["capture"] = Process(labanmesh("capture", stage.file, "-o", small_disk / "a.mcap"))
        stage.play()
        witness = stage.witness()
        witness.wait_for(all_count, why="all count")
        status = capture.wait()
        assert (status, capture.log.count("\n")) == (1, 1), capture.log
        assert "a.mcap" in capture.log and "space" in capture.log
        ended_ns = witness.last["at_ns"]
        witness.wait_for(lambda w: w.last["at_ns"] > ended_ns + SECOND_NS and all_count(w), SOON_S, "the scene goes on")
        records = list(CaptureFile(small_disk / "a.mcap").records())
        assert len(records) > 20 and any(record.key.endswith("judgement") for record in records)
