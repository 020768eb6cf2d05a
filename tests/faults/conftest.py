"""What the fault suite shares: a performance with its models, two hosts, and how long to make processes suffer.
LABANMESH_FAULTS=long is the long form (`make faults`): a hundred kills instead of five, all ways of pulling a cable."""

import os
import shutil
import subprocess

import fault_hosts
import pytest
from fault_processes import Process
from fault_stage import LONG, SERVICES, Replay, Stage
from processes import labanmesh

DISK_KB = 96
"""A scene of three observers fills it in about a second with a capture."""


@pytest.fixture(scope="session")
def long_form():
    """Whether to take the time that the long form takes."""
    return LONG


@pytest.fixture(scope="session")
def replay(tmp_path_factory):
    """The performance and one model a view."""
    return Replay(tmp_path_factory)


@pytest.fixture
def team(replay, tmp_path):
    """Router, two fusion services, three observers and a hub on this machine, playing."""
    with Stage(replay, tmp_path, fusions=SERVICES) as stage:
        stage.processes["hub"] = Process(labanmesh("watch", stage.file, "--json"))
        stage.play()
        yield stage


@pytest.fixture
def hosts():
    """Two hosts joined by a cable; without root and tools the test is skipped, and says why."""
    missing = fault_hosts.why_not("nft")
    if missing:
        pytest.skip(missing)
    with fault_hosts.Hosts() as both:
        yield both


@pytest.fixture
def small_disk(request, tmp_path):
    """A disk of its own, in memory, of DISK_KB or as many as the test is parametrized with."""
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("only root can mount a small disk")
    place, size_kb = tmp_path / "disk", getattr(request, "param", DISK_KB)
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size_kb}k", "tmpfs", str(place)])
    if mounted.returncode:
        pytest.skip("no disk can be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)
