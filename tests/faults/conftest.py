"""What the fault suite shares: a performance with its models, two hosts, and how long to make processes suffer.

LABANMESH_FAULTS=long is the long form (`make faults`): a hundred kills instead of five, all ways of pulling a cable.
"""

import os
import sys
from pathlib import Path

import pytest

# The suite's own modules, and this repository's before an installed one, for the processes that are started too.
sys.path.append(str(Path(__file__).parent))

import fault_hosts
from fault_processes import Process, labanmesh
from fault_stage import SERVICES, Replay, Stage


@pytest.fixture(scope="session")
def long_form():
    """Whether to take the time that the long form takes."""
    return os.environ.get("LABANMESH_FAULTS") == "long"


@pytest.fixture(scope="session")
def replay(tmp_path_factory):
    """The performance and one model a view, made once a test process."""
    return Replay(tmp_path_factory.mktemp("replay"))


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
