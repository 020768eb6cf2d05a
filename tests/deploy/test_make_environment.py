"""The environments of make: how far they are, and one line that says what to do when they fail."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from processes import SOON_S

SCRIPT = Path(__file__).parents[2] / "deploy" / "make_environment.py"
STAND_IN = """#!/bin/sh
case "$*" in
*"-m venv "*) mkdir -p "$3/bin" && cp "$0" "$3/bin/python" && cat "$TOLD/venv" && exit $VENV ;;
*"-m pip install"*) cat "$TOLD/pip"; exit $PIP ;;
*) exit 0 ;;
esac
"""
FETCHED = """Looking in indexes: https://index.example/simple
Collecting numpy<3,>=1.26 (from labanmesh==0.1.0)
  Downloading numpy-2.4.6-cp311-cp311-manylinux_2_27_x86_64.whl (16.8 MB)
"""
NO_NETWORK = """WARNING: Retrying (Retry(total=0, connect=None)) after connection broken: /simple/numpy/
ERROR: Could not find a version that satisfies the requirement numpy<3,>=1.26 (from labanmesh) (from versions: none)
ERROR: No matching distribution found for numpy<3,>=1.26
"""
NO_WHEEL = "ERROR: Could not find a version\nERROR: No matching distribution found for mediapipe<0.10.22\n"


@pytest.fixture
def make(tmp_path):
    """Makes an environment with a stand-in for Python; gives status and the lines on stderr."""
    stand_in = tmp_path / "python"
    stand_in.write_text(STAND_IN)
    stand_in.chmod(0o755)

    def call(pip, status=0, venv="", venv_status=0):
        (tmp_path / "pip").write_text(pip)
        (tmp_path / "venv").write_text(venv)
        run = f"sys.executable = {str(stand_in)!r}; runpy.run_path({str(SCRIPT)!r}, run_name='__main__')"
        words = [str(tmp_path / "room"), ".[all]", "--target", "install", "--no-windows"]
        environment = {**os.environ, "TOLD": str(tmp_path), "PIP": str(status), "VENV": str(venv_status)}
        command = [sys.executable, "-c", f"import sys, runpy; {run}", *words]
        ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=SOON_S, check=False)
        assert ended.stdout == ""
        return ended.returncode, [line.removeprefix(f"{tmp_path / 'room'}: ") for line in ended.stderr.splitlines()]

    return call


def test_it_says_what_it_does_and_ends_with_ready(make):
    status, lines = make(FETCHED)
    assert status == 0 and len(lines) == 2
    assert lines[0].startswith("an environment of Python (once") and lines[1].startswith("ready after ")


@pytest.mark.parametrize(
    ("pip", "line"),
    [
        (FETCHED + NO_NETWORK, "no package index answers; check the network, or name a mirror by PIP_INDEX_URL"),
        (FETCHED + NO_WHEEL, "ERROR: No matching distribution found for mediapipe<0.10.22"),
        (FETCHED + "ERROR: [Errno 28] No space left on device\n", "the disk is full; make room, 3 GB"),
    ],
)
def test_a_failure_ends_with_one_line_that_says_what_to_do(make, tmp_path, pip, line):
    status, lines = make(pip, status=1)
    assert status == 1 and lines[-1].startswith(f"not ready: {line}") and "; then make install again" in lines[-1]
    assert str(tmp_path / "room" / "install.log") in lines[-1] and (tmp_path / "room/install.log").read_text() == pip


def test_a_python_without_venv_is_one_line(make):
    status, lines = make("", venv="The environment was not created: ensurepip is not available.\n", venv_status=1)
    assert status == 1 and lines[-1].startswith("not ready: Python has no venv; Debian: apt install python3-venv; then")
