"""What all tests share: where the recordings of real people lie."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of recordings, named by LABANMESH_DATA; tests that need it skip without it."""
    place = os.environ.get("LABANMESH_DATA")
    if not place:
        pytest.skip("LABANMESH_DATA is not set: the recordings of real people are not here")
    return Path(place)
