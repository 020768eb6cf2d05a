"""Fixtures of the observer's tests."""

import sys
from pathlib import Path

import pytest

import labanmesh

# The builders that these tests share.
sys.path.append(str(Path(__file__).parent))


@pytest.fixture
def run(capsys):
    """Run `labanmesh` with these words; returns the exit status and what was printed to stdout and stderr."""

    def call(*words):
        status = labanmesh.main([str(word) for word in words])
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    return call
