"""What all tests share: where the recordings of real people lie."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# Before NumPy is imported: the workers, and the processes that tests start, would fight for the cores.
for _library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# A deadline measures the machine. In CI, Hypothesis has a profile of its own, with fixed examples.
settings.register_profile("desk", deadline=None)
if not os.environ.get("CI"):
    settings.load_profile("desk")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The slow tests begin first, so that no worker is left with a long one at the end."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of recordings, named by LABANMESH_DATA; tests that need it skip without it."""
    place = os.environ.get("LABANMESH_DATA")
    if not place:
        pytest.skip("LABANMESH_DATA is not set: the recordings of real people are not here")
    return Path(place)
