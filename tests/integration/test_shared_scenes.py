"""Many scenes shared by several fusion services, between real Zenoh peers: taking, handing over, dying."""

import time

import pytest
from processes import SOON_S

from benchmarks.crowd.crowd import NAMES, OBSERVERS, Crowd, scene_name
from benchmarks.crowd.trial import CrowdPlan, run_trial
from common.config import MeshConfig, ObserverConfig, Scene
from common.messages import JudgementMessage
from common.wire import decode
from fusion.ownership import rendezvous_rank
from fusion.server import serve
from labanmesh_testing.mesh import Mesh

SCENES = 6
KEPT_WAITING_S = 0.1
"""Two frames and a half of the crowd: a longer gap of all observers at once is none of its plan."""


class Region:
    """Fusion services that share scenes, and a crowd of simulated observers."""

    def __init__(self, mesh):
        self.mesh, self.services = mesh, {}
        self.judgements = mesh.peer("hub").inbox("laban/*/judgement", limit=100_000)
        self.crowd = Crowd(mesh.peer("observer"), SCENES, 25.0)

    def scenes(self):
        observers = {f"cam{n}": ObserverConfig(source="simulated") for n in range(OBSERVERS)}
        common = {"vocabulary": NAMES.labels, "vocabulary_name": NAMES.name, "observers": observers}
        return [Scene(scene=scene_name(n), mesh=self.mesh.config, **common) for n in range(SCENES)]

    def publish(self, stop):
        while not stop.is_set():
            self.crowd.publish(0.2)

    def begin(self, service):
        link = self.mesh.peer("standby")

        def body(stop):
            try:
                serve(self.scenes(), service, link, stop, shared=True)
            except Exception:
                # A killed process reports no fault.
                if service in self.services:
                    raise

        self.services[service] = (*self.mesh.run(body), link)

    def kill(self, service):
        """Its session ends first, so that it publishes nothing more."""
        stop, thread, link = self.services.pop(service)
        link._session.close()
        stop.set()
        thread.join(SOON_S)
        link.close()

    def wait_for_judges(self, *services):
        """Wait until each scene's newest judgement is by its owner among `services` and half a second old at most."""
        owners, newest, end_s = share_of(*services), {}, time.monotonic() + SOON_S
        while time.monotonic() < end_s:
            for arrival in self.judgements.take(0.1):
                judgement = decode(JudgementMessage, arrival.payload)
                newest[judgement.scene] = (judgement.fusion, arrival.arrived_ns)
            now_ns = time.time_ns()
            if {s: f for s, (f, at_ns) in newest.items() if now_ns - at_ns < 5e8} == owners:
                return
        raise AssertionError(f"{newest} are judged, and should be {owners}")


def share_of(*services):
    return {scene_name(n): rendezvous_rank(scene_name(n), services)[0] for n in range(SCENES)}


@pytest.fixture
def region():
    mesh = Mesh(MeshConfig(mode="process", endpoint="tcp/127.0.0.1:0"))
    yield Region(mesh)
    mesh.close()


def test_a_service_that_joins_or_dies_moves_only_its_share_and_each_movement_is_decided_once(region):
    region.begin("north")
    quiet, talking = region.mesh.run(region.publish)
    region.wait_for_judges("north")
    region.begin("south")
    region.wait_for_judges("north", "south")
    assert set(share_of("north", "south").values()) == {"north", "south"}
    region.begin("east")
    region.wait_for_judges("north", "south", "east")
    region.kill("south")
    region.wait_for_judges("north", "east")
    quiet.set()
    talking.join(SOON_S)
    region.crowd.settle(4.0)
    counts = region.crowd.counts
    # The first of a scene may have gone on while nobody judged yet.
    assert counts.movements - counts.right <= SCENES
    assert counts.doubled == 0
    late = {scene: done[2:] for scene, done in counts.done.items()}
    assert all(counts.ended[scene][-len(done) :] == done for scene, done in late.items() if done)


def test_real_processes_one_is_killed_and_another_started(tmp_path):
    plan = CrowdPlan(scenes=4, rate_hz=25.0, seconds=6.0, processes=2, kill=True, warm_up_s=3.0)
    # The crowd goes by the clock. Where the machine kept it waiting its own gaps cut movements in two: such a trial
    # says nothing about the services, and is made again.
    for number in range(3):
        log, folder = [], tmp_path / str(number)
        folder.mkdir()
        outcome = run_trial(plan, folder, log.append)
        assert ["killed fusion1" in log, "started fusion2" in log] == [True, True]
        if outcome.counts.late_s <= KEPT_WAITING_S:
            break
    counts = outcome.counts
    assert counts.doubled == 0
    assert outcome.whole or counts.late_s > KEPT_WAITING_S, (outcome.table(), counts.done, counts.ended)
    assert counts.right >= 0.9 * counts.movements
