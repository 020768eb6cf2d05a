"""Many scenes shared by several fusion services, between real Zenoh peers: taking, handing over, dying."""

import sys
import threading
import time
from pathlib import Path

import pytest

# The benchmarks are no part of what is installed.
sys.path.append(str(Path(__file__).parents[2]))

from benchmarks.crowd.crowd import NAMES, OBSERVERS, Crowd, scene_name
from benchmarks.crowd.trial import CrowdPlan, run_trial
from common.config import MeshConfig, ObserverConfig, Scene
from common.link import Link
from common.messages import JudgementMessage
from common.wire import decode
from fusion.ownership import rendezvous_rank
from fusion.server import serve

SCENES = 6
SOON_S = 20.0


class Region:
    """Fusion services in threads of this process, and a crowd of simulated observers that talks until it closes."""

    def __init__(self):
        self.meeting = Link.open(MeshConfig(mode="process", endpoint="tcp/127.0.0.1:0"), "fusion")
        self.mesh = MeshConfig(mode="process", endpoint=self.meeting.locator)
        self.running, self.faults = {}, []
        self.hub = Link.open(self.mesh, "hub")
        self.judgements = self.hub.inbox("laban/*/judgement", limit=100_000)
        self.crowd_link = Link.open(self.mesh, "observer")
        self.crowd = Crowd(self.crowd_link, SCENES, 25.0)
        self.quiet = threading.Event()
        self.talking = threading.Thread(target=self._talk)

    def scenes(self):
        judges = {f"cam{n}": ObserverConfig(source="simulated") for n in range(OBSERVERS)}
        for number in range(SCENES):
            scene = Scene(scene=scene_name(number), vocabulary=NAMES.labels, vocabulary_name=NAMES.name,
                          mesh=self.mesh, observers=judges)  # fmt: skip
            yield scene

    def begin(self, service):
        link, stop = Link.open(self.mesh, "standby"), threading.Event()

        def body():
            try:
                serve(list(self.scenes()), service, link, stop, shared=True)
            except Exception as error:  # noqa: BLE001 - told when the region closes
                self.faults.append(error)

        thread = threading.Thread(target=body)
        thread.start()
        self.running[service] = (stop, thread, link)

    def die(self, service):
        """As if it was killed: its session ends first, so that it can say nothing more."""
        stop, thread, link = self.running.pop(service)
        link._session.close()
        stop.set()
        thread.join(SOON_S)
        link.close()
        self.faults.clear()

    def _talk(self):
        while not self.quiet.is_set():
            self.crowd.publish(0.2)

    def who_judges(self, expected):
        """Wait until the newest judgement of each scene is by whom `expected` says, and all within half a second."""
        newest, end_s = {}, time.monotonic() + SOON_S
        while time.monotonic() < end_s:
            for arrival in self.judgements.take(0.1):
                said = decode(JudgementMessage, arrival.payload)
                newest[said.scene] = (said.fusion, arrival.arrived_ns)
            now_ns = time.time_ns()
            if {s: f for s, (f, at_ns) in newest.items() if now_ns - at_ns < 5e8} == expected:
                return
        raise AssertionError(f"{newest} are judged, and should be {expected}")

    def close(self):
        self.quiet.set()
        if self.talking.ident:
            self.talking.join(SOON_S)
        for service in list(self.running):
            stop, thread, link = self.running.pop(service)
            stop.set()
            thread.join(SOON_S)
            link.close()
        for link in (self.crowd_link, self.hub, self.meeting):
            link.close()
        assert self.faults == []


@pytest.fixture
def region():
    made = Region()
    yield made
    made.close()


def share_of(*services):
    return {scene_name(n): rendezvous_rank(scene_name(n), services)[0] for n in range(SCENES)}


def test_who_comes_and_who_dies_moves_only_its_share_and_no_movement_is_lost_or_doubled(region):
    region.begin("north")
    region.talking.start()
    region.who_judges(share_of("north"))
    region.begin("south")
    region.who_judges(share_of("north", "south"))
    assert set(share_of("north", "south").values()) == {"north", "south"}
    region.begin("east")
    region.who_judges(share_of("north", "south", "east"))
    region.die("south")
    region.who_judges(share_of("north", "east"))
    region.quiet.set()
    region.talking.join(SOON_S)
    region.crowd.settle(4.0)
    account = region.crowd.counts
    # The first of a scene may have gone on while nobody judged yet.
    assert account.movements - account.right <= SCENES
    assert account.doubled == 0
    late = {scene: done[2:] for scene, done in account.done.items()}
    assert all(account.ended[scene][-len(done) :] == done for scene, done in late.items() if done)


def test_real_processes_one_of_them_killed_another_started(tmp_path):
    told = []
    plan = CrowdPlan(scenes=8, rate_hz=25.0, seconds=6.0, processes=2, kill=True, warm_up_s=3.0)
    outcome = run_trial(plan, tmp_path, told.append)
    assert ["killed fusion1" in told, "started fusion2" in told] == [True, True]
    account = outcome.counts
    assert account.doubled == 0
    # Where the machine stopped everybody for long, the crowd's own gaps cut movements in two.
    assert outcome.whole or account.late_s > 0.2, (outcome.table(), account.done, account.ended)
    assert account.right >= 0.9 * account.movements
