"""Captures for the tests of replay."""

import pytest
from replay_stage import NOON, a_scene, recorded, steps

from common.capture_file import CaptureFile, CaptureWriter


@pytest.fixture
def records():
    """The records of PLAY."""
    return recorded(a_scene(), steps())


@pytest.fixture
def write(tmp_path):
    def write_capture(records, scene=None, name="a.mcap"):
        path = tmp_path / name
        path.unlink(missing_ok=True)
        with CaptureWriter(path, scene or a_scene(), "", NOON) as writer:
            for record in records:
                writer.write(record)
        return CaptureFile(path)

    return write_capture
