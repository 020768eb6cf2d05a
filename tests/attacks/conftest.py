"""What the attacks share. LABANMESH_ATTACKS=long is the long form (`make attacks`): real processes, a recorded person.
In the short form the same attacks meet services in this process. LABANMESH_ATTACKS_SEED repeats a run."""

import os
import random
from pathlib import Path

import pytest
from attack_history import SEED, History
from attack_person import meet, scripted
from attack_stage import ASK_CLOCKS_S, Dojo, Village

HERE = Path(__file__).parent
LONG = os.environ.get("LABANMESH_ATTACKS") == "long"


@pytest.fixture(scope="session")
def long_form():
    """Whether to attack real processes, for long."""
    return LONG


@pytest.fixture(scope="session")
def person():
    """Whom the judges see: in the long form a recorded person."""
    return meet() if LONG else scripted()


OPEN = []
"""The stage while attacks go on. It ends before other tests, which its services would disturb."""


@pytest.fixture
def shared(person, tmp_path_factory):
    """Ten scenes in one fusion service, four judges each, a standby service for the first; all count."""
    if not OPEN:
        folder = tmp_path_factory.mktemp("attacks")
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("fusion.server.ASK_CLOCKS_S", ASK_CLOCKS_S)
            OPEN.append((Dojo if LONG else Village)(person, folder))
            OPEN[0].until_all_count()
    return OPEN[0]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item, nextitem):
    """End the stage when no attack follows."""
    result = yield
    if OPEN and (nextitem is None or HERE not in nextitem.path.parents):
        OPEN.pop().close()
    return result


@pytest.fixture
def history(request):
    """The history of this run, which is kept however it ends."""
    history = History(request.node.nodeid, int(os.environ.get(SEED, "17")))
    yield history
    history.keep()


@pytest.fixture
def chance(history):
    """Chance that the seed repeats."""
    return random.Random(history.seed)  # noqa: S311 - to be repeated


@pytest.fixture
def stage(shared, history):
    """The stage, which survives the attack: every service still runs at the end, and all judges count again."""
    with shared.attacked(history):
        yield shared
        shared.until_all_count()
        assert shared.alive(), shared.faults
