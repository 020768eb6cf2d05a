"""What all tests share: where the recordings of real people lie."""

import gc
import os
import sys
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

import pytest
from hypothesis import settings

import common.parallel
import common.progress

BY_THE_CLOCK = {"attacks", "deploy", "e2e", "examples", "faults", "hub", "integration"}
"""Folders of tests that start processes and wait for them: they need little of a processor, and need it at once."""

NICE = 5
"""Steps of priority that a calculation leaves to tests by the clock: of a core that they share it gets a quarter."""

# Before NumPy is imported: the workers, and the processes that tests start, would fight for the cores.
for _library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# What a command prints must not depend on how long it takes.
common.progress.BEGIN_S = 3600.0

# The workers of this run have the cores already; a process that learns takes a second to start. Tests of several name
# their number, and commands that run as processes of their own take what there is.
common.parallel.cores = lambda: 1

# A deadline measures the machine. In CI, Hypothesis's own profile repeats the same examples for the same test, so that
# more of them find nothing new; at a desk each run draws other ones. A third of its hundred keeps `make test` short.
_profile = settings.get_profile("ci" if os.environ.get("CI") else "default")
settings.register_profile("ours", _profile, deadline=None, max_examples=33)
settings.load_profile("ours")


# Each worker holds all tests: the collector of cycles would walk over them while they are read, and in every test.
gc.disable()


def pytest_collection(session: pytest.Session) -> None:
    """In a fresh clone each worker would rewrite the assertions of all files, which takes longer than reading them: it
    begins with its share of the files, and finds the others as other workers have left them."""
    worker = getattr(session.config, "workerinput", None)
    if worker is None:
        return
    left_out, root = session.config.getini("norecursedirs"), session.config.rootpath
    files = sorted(file for place in session.config.args for file in (root / place).rglob("test_*.py"))
    files = [f for f in files if not any(fnmatch(part, n) for part in f.relative_to(root).parts for n in left_out)]
    for file in files[int(worker["workerid"][2:]) :: worker["workercount"]]:
        try:
            pytest.Module.from_parent(session, path=file).obj  # noqa: B018 - imports it
        except (pytest.Collector.CollectError, pytest.skip.Exception):
            # It is imported again, and this reported, where its tests are collected.
            for name in [n for n, module in sys.modules.items() if getattr(module, "__file__", None) == str(file)]:
                del sys.modules[name]


def pytest_collection_finish() -> None:
    """What has been read stays until the end; from now on only what tests leave is searched for cycles."""
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Half of the workers begin with tests by the clock, the others with calculations, and these give way to processes.
    pytest-xdist gives each worker an equal part of the list, in its order; those that are done take from others'
    ends."""
    worker = getattr(config, "workerinput", {"workerid": "gw0", "workercount": 1})
    parts: list[list[pytest.Item]] = [[] for _ in range(worker["workercount"])]
    waiting = -(-len(parts) // 2)
    if int(worker["workerid"][2:]) >= waiting:
        os.nice(NICE)
    files: dict[Path, list[pytest.Item]] = {}
    for item in items:
        files.setdefault(item.path, []).append(item)
    by_the_clock = [path for path in files if BY_THE_CLOCK & set(path.parts)]
    slow = [path for path in files if path not in by_the_clock and any(map(_is_slow, files[path]))]
    for paths, of_them in ((by_the_clock, parts[:waiting]), (slow, parts[waiting:] or parts)):
        for n, path in enumerate(paths):
            of_them[n % len(of_them)] += files.pop(path)
    short = [item for tests in files.values() for item in tests]
    for part in parts:
        missing = max(-(-len(items) // len(parts)) - len(part), 0)
        part += short[:missing]
        del short[:missing]
    items[:] = [item for part in parts for item in part]


def _is_slow(item: pytest.Item) -> bool:
    return item.get_closest_marker("slow") is not None


@pytest.fixture(scope="session", autouse=True)
def _runtime_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A runtime folder of this process and those that it starts: `labanmesh up` locks a scene by its name, and other
    runs of these tests on this machine use the same names."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("runtime")))
        yield


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of recordings, named by LABANMESH_DATA; tests that need it skip without it."""
    place = os.environ.get("LABANMESH_DATA")
    if not place:
        pytest.skip("LABANMESH_DATA is not set: the recordings of real people are not here")
    return Path(place)


@pytest.fixture(scope="session")
def msr(data):
    """Hands and head of MSR Action3D, which take half a second to read. Tests leave them as they are."""
    from observer.motion.importers import import_recordings
    from observer.tracks import BODY_PARTS
    from studies.sensors import with_parts

    return with_parts(import_recordings("msr-action3d", data / "msr_action3d").archive, BODY_PARTS)
