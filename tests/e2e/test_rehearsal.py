"""`labanmesh teach --rehearse` as a person sees it, up to its first take; Ctrl-C then ends all of its processes."""

import signal
from contextlib import suppress
from pathlib import Path

import pytest
from e2e_stage import started
from processes import labanmesh, until

from observer.tracking.head import have_cascade

QUICK = ("--countdown", "0", "--takes", "2", "--no-test")


def running(folder):
    """The processes that were started in `folder`."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cwd"):
        with suppress(OSError):
            found += [entry] * (entry.readlink() == folder)
    return found


@pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")
def test_a_performer_acts_the_lesson_before_cameras_and_ctrl_c_ends_all(tmp_path):
    with started(tmp_path, labanmesh("teach", "--rehearse", "byebye", "maestro", *QUICK)) as teach:
        lines = []
        while not any("byebye 1 of 2: kept by" in line for line in lines):
            lines.append(teach.stdout.readline())
            assert lines[-1], teach.stderr.read()
        assert "SYNTHETIC performer" in lines[0] and len(running(tmp_path)) >= 5
        teach.send_signal(signal.SIGINT)
        assert teach.wait() == 130 and "the same command goes on" in teach.stdout.read()
        until(lambda: not running(tmp_path), "all processes have ended")
    scene = tmp_path / "labanmesh-rehearsal"
    assert {"scene.toml", "performance.npz"} <= {path.name for path in scene.iterdir()}
    assert list(scene.glob("*.tracks.npz")), "the take is kept: the same command goes on"
