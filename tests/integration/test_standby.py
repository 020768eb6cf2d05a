"""Two fusion services and an observer, between real Zenoh peers."""

import threading
import time

import pytest
from mesh_stage import LOOPBACK, NAMED, first, posterior, up_to
from processes import SOON_S, until

from common import SECOND_NS
from common.config import read_scene
from common.messages import JudgementMessage, OngoingMovement, StatusMessage, VerdictMessage
from common.wire import decode, encode
from fusion.checkpoint import CheckpointFile
from fusion.same_id import SameIdError
from fusion.server import serve

PATIENT_S = 2.0
"""A service in a thread of a busy machine may be silent for so long; one whose token is gone is succeeded at once."""
HOUR_NS = 3600 * SECOND_NS
REST, BOWING = ([0.5, 0.5], 0.95), ([0.98, 0.02], 0.05)


@pytest.fixture
def scene(tmp_path):
    text = (
        f'scene = "dojo"\n{NAMED}{LOOPBACK}[observers.cam1]\nsource = "m.npz"\n'
        '[fusion]\nid = "a"\nstandby = ["b"]\nhold_s = 0.1\ntakeover_s = 0.6\n'
    )
    (tmp_path / "s.toml").write_text(text)
    return read_scene(tmp_path / "s.toml", {})


class Stage:
    """Fusion services that can be ended one by one, one observer, and a hub. state: what the observer publishes, p and
    rest. same_ids: the services that ended because another has their id."""

    def __init__(self, mesh, scene):
        self.mesh, self.scene, self.keys = mesh, scene, scene.keys
        self.services, self.clocks, self.same_ids = {}, {}, []
        self.observer, self.hub = mesh.peer("observer"), mesh.peer("hub")
        self.publisher = self.observer.publisher(self.keys.posterior("cam1"))
        self._judgements, self._verdicts = self.hub.inbox(self.keys.judgement), self.hub.inbox(self.keys.verdict)
        self.seq, self.state = 0, REST

    def begin(self, service, own="", takeover_s=None):
        """Start one more fusion service. takeover_s: its own, by default the scene's."""
        link, scene = self.mesh.peer("standby"), self.scene
        if takeover_s is not None:
            fusion = scene.fusion.model_copy(update={"takeover_s": takeover_s})
            scene = scene.model_copy(update={"fusion": fusion})
        self.clocks[service] = ticking = threading.Event()
        ticking.set()

        def clock():
            ticking.wait()
            return time.time_ns()

        def body(stop):
            try:
                serve([scene], own or service, link, stop, clock)
            except SameIdError as error:
                self.same_ids.append(error)

        self.services[service] = (*self.mesh.run(body), link)

    def play(self, service, *others):
        """Start these services and the observer, which publishes 50 posteriors a second; wait until it counts."""
        self.begin(service)
        self.mesh.run(self._publish)
        self.judgement(lambda j: j.fusion == service and j.votes["cam1"].state == "counted")
        for other in others:
            self.stand_by(other)

    def stand_by(self, service, takeover_s=PATIENT_S):
        """Start one more fusion service that stands by, and would take over by itself only after so long a silence."""
        statuses = self.statuses(service)
        self.begin(service, takeover_s=takeover_s)
        first(statuses, StatusMessage, standing_by)

    def _publish(self, stop):
        while not stop.wait(0.02):
            p, rest = self.state
            self.publisher.put(posterior(seq=self.seq, p=p, rest=rest))
            self.seq += 1

    def end(self, service):
        """Its process ends: the link closes with it."""
        stop, thread, link = self.services.pop(service)
        stop.set()
        thread.join(SOON_S)
        link.close()

    def freeze(self, service):
        """Its loop hangs in the middle, and its link stays open: no liveliness token disappears."""
        self.clocks[service].clear()

    def judgements(self, fits):
        return up_to(self._judgements, JudgementMessage, fits)

    def judgement(self, fits):
        return self.judgements(fits)[-1]

    def verdicts(self, fits=lambda verdict: True):
        return up_to(self._verdicts, VerdictMessage, fits)

    def decide(self):
        """The observer sees bowing; the verdict on it."""
        self.state = BOWING
        return self.verdicts()[-1]

    def statuses(self, service):
        return self.hub.inbox(self.keys.fusion_status(service))

    def lone(self, **more):
        """From now on there is one fusion service in the scene file."""
        fusion = self.scene.fusion.model_copy(update={"standby": (), **more})
        self.scene = self.scene.model_copy(update={"fusion": fusion})


@pytest.fixture
def stage(mesh, scene):
    made = Stage(mesh, scene)
    yield made
    for ticking in made.clocks.values():
        ticking.set()
    assert made.same_ids == []


def standing_by(status):
    return status.state == "running" and status.reason == "standing by for a"


def test_when_the_leader_ends_the_standby_service_continues_the_same_movement_at_once(stage):
    """By the leader's token: after its silence alone it would wait until the end of the test."""
    stage.play("a")
    stage.stand_by("b", 10 * SOON_S)
    decided = stage.decide()
    assert (decided.label, decided.fusion, decided.ended_ns) == ("bowing", "a", None)
    stage.judgement(lambda j: j.movement is not None and j.movement.label == "bowing")
    stage.end("a")
    continued = stage.judgement(lambda j: j.fusion == "b")
    assert continued.movement.id == decided.id and continued.movement.label == "bowing"
    stage.state = REST
    ended = stage.verdicts(lambda v: v.ended_ns is not None)
    assert [(v.id, v.fusion) for v in ended] == [(decided.id, "b")]


def test_a_movement_that_ends_while_the_leader_hangs_is_published_by_the_next_leader(stage):
    stage.play("a")
    stage.stand_by("b", 1.0)
    decided = stage.decide()
    stage.freeze("a")
    stage.state = REST  # the movement ends a tenth of a second from now; nobody leads for a second
    ended = stage.verdicts()[-1]
    continued = stage.judgement(lambda j: j.fusion == "b")
    assert (ended.id, ended.fusion) == (decided.id, "b") and ended.ended_ns is not None
    assert ended.at_ns <= continued.at_ns and continued.movement is None


def test_a_service_that_begins_after_the_last_message_of_the_owner_goes_on_with_its_movement(stage):
    """It asks for it: the owner publishes nothing more, and no file has the movement."""
    fusion = stage.scene.fusion.model_copy(update={"memory": ""})
    stage.scene = stage.scene.model_copy(update={"fusion": fusion})
    stage.play("a")
    decided = stage.decide()
    stage.judgement(lambda j: j.movement is not None and j.movement.label == "bowing")
    stage.freeze("a")
    stage.begin("b")
    continued = stage.judgement(lambda j: j.fusion == "b")
    assert continued.movement is not None and continued.movement.id == decided.id
    stage.state = REST
    ended = stage.verdicts(lambda v: v.ended_ns is not None)
    assert [(v.id, v.fusion) for v in ended] == [(decided.id, "b")]


def test_a_standby_service_publishes_its_status_and_nothing_else(stage):
    stage.begin("a")
    stage.judgement(lambda j: j.fusion == "a")
    stage.stand_by("b")
    assert {j.fusion for j in stage.judgements(lambda j: j.seq > 30)} == {"a"}
    answers = stage.hub.ask_each(stage.keys.judgement, SOON_S)
    assert [decode(JudgementMessage, payload).fusion for _, payload in answers] == ["a"]


def test_a_late_joiner_gets_the_last_verdicts_from_any_leader(stage):
    stage.play("a", "b")
    for _ in range(2):
        stage.decide()
        stage.state = REST
        stage.verdicts(lambda v: v.ended_ns is not None)
    both = stage.mesh.peer("hub").ask_each(stage.keys.verdict, SOON_S)
    assert len(both) == 4, "the owner alone answers"
    stage.end("a")
    stage.judgement(lambda j: j.fusion == "b")
    answers = stage.mesh.peer("hub").ask_each(stage.keys.verdict, SOON_S)
    verdicts = [decode(VerdictMessage, payload) for _, payload in answers]
    assert [v.ended_ns is None for v in verdicts] == [True, False, True, False]
    assert [v.decided_ns for v in verdicts] == sorted(v.decided_ns for v in verdicts)


def test_a_service_whose_id_is_taken_does_not_start(stage, monkeypatch):
    monkeypatch.setattr("fusion.same_id.ASK_EVERY_S", 0.05)
    stage.begin("a")
    stage.judgement(lambda j: j.fusion == "a")
    with pytest.raises(SameIdError, match="alive already; stop it, or give this one an id of its own"):
        serve([stage.scene], "a", stage.mesh.peer("standby"), threading.Event())


def test_a_lone_service_continues_after_a_restart(stage, tmp_path):
    stage.lone(memory=str(tmp_path / "memory.json"))
    stage.play("a")
    decided = stage.decide()
    stage.judgement(lambda j: j.movement is not None and j.movement.label is not None)
    stage.end("a")
    stage.begin("a")
    stage.judgement(lambda j: j.movement is not None and j.movement.id == decided.id)
    stage.state = REST
    assert [(v.id, v.ended_ns is not None) for v in stage.verdicts()] == [(decided.id, True)]


def test_a_movement_from_long_before_a_restart_ends_when_it_was_judged_last(stage, tmp_path):
    path = tmp_path / "memory.json"
    stage.lone(memory=str(path))
    stage.play("a")
    decided = stage.decide()
    stage.judgement(lambda j: j.movement is not None and j.movement.label is not None)
    stage.end("a")
    stage.state = REST
    checkpoint = CheckpointFile(path).read(stage.scene.scene)
    judgement = checkpoint.judgement.model_copy(update={"at_ns": checkpoint.judgement.at_ns - HOUR_NS})
    verdict = checkpoint.verdict.model_copy(update={"decided_ns": judgement.at_ns - SECOND_NS})
    path.write_text(checkpoint.model_copy(update={"judgement": judgement, "verdict": verdict}).to_json())
    stage.begin("a")
    (ended,) = stage.verdicts()
    assert (ended.id, ended.stage, ended.ended_ns) == (decided.id, "ended", judgement.at_ns)


def test_an_end_that_was_lost_with_the_router_is_sent_after_the_restart_of_a_service_that_was_killed(stage, tmp_path):
    path = tmp_path / "memory.json"
    stage.lone(memory=str(path))
    stage.play("a")
    decided = stage.decide()
    stage.state = REST
    (ended,) = stage.verdicts()
    stage.judgement(lambda j: j.movement is None)
    stage.end("a")
    checkpoint = CheckpointFile(path).read(stage.scene.scene)
    assert checkpoint.undelivered == ()
    path.write_text(checkpoint.model_copy(update={"undelivered": (ended,)}).to_json())
    stage.begin("a")
    (again,) = stage.verdicts()
    assert (again.id, again.label, again.stage, again.ended_ns) == (decided.id, decided.label, "ended", ended.ended_ns)
    stage.judgement(lambda j: j.fusion == "a")
    until(lambda: CheckpointFile(path).read(stage.scene.scene).undelivered == ())


def test_after_both_services_were_killed_the_movement_goes_on_under_its_id(stage):
    """The standby service fuses before it knows that it is the owner: its own begin of the movement must not count."""
    stage.play("a", "b")
    decided = stage.decide()
    stage.judgement(lambda j: j.movement is not None and j.movement.label is not None)
    for service in ("a", "b"):
        stage.end(service)
    stage.begin("b")
    stage.judgement(lambda j: j.fusion == "b" and j.movement is not None and j.movement.id == decided.id)
    stage.state = REST
    assert [(v.id, v.stage) for v in stage.verdicts()] == [(decided.id, "ended")]


def test_of_two_processes_with_one_id_that_start_together_one_ends(stage, monkeypatch):
    monkeypatch.setattr("fusion.same_id.IdCheck.is_free", lambda *_: True)
    monkeypatch.setattr("fusion.same_id.ASK_EVERY_S", 0.05)
    stage.lone()
    stage.begin("a")
    stage.begin("a2", own="a")
    until(lambda: stage.same_ids)
    assert len(stage.same_ids) == 1
    stage.same_ids.clear()
    ended_ns = time.time_ns()
    session = stage.judgement(lambda j: j.at_ns > ended_ns).session
    assert {j.session for j in stage.judgements(lambda j: j.at_ns > ended_ns + 1e9)} == {session}


@pytest.fixture
def rival(stage):
    """Another fusion service, as it is heard when a split network is whole again; publishes a judgement repeatedly.
    Returns what ends it."""
    link = stage.mesh.peer("standby")
    link.announce(stage.keys.fusion_alive("b"))
    publisher = link.publisher(stage.keys.judgement)

    def publish(judgement, epoch, movement):
        fields = {"fusion": "b", "session": "rival", "epoch": epoch, "movement": movement}
        payload = encode(judgement.model_copy(update=fields))

        def repeat(stop):
            publisher.put(payload)
            while not stop.wait(0.1):
                publisher.put(payload)

        stop, publishing = stage.mesh.run(repeat)

        def end():
            stop.set()
            publishing.join(SOON_S)

        return end

    return publish


def test_after_a_split_the_service_that_stands_down_ends_its_movement_and_names_the_other(stage, rival):
    stage.play("a")
    decided = stage.decide()
    judgement = stage.judgement(lambda j: j.movement is not None and j.movement.label is not None)
    rival(judgement, 99, judgement.movement.model_copy(update={"id": "dojo-7", "label": "lunging"}))
    ended = stage.verdicts(lambda v: v.ended_ns is not None)[-1]
    assert (ended.id, ended.label, ended.fusion, ended.same_as) == (decided.id, "bowing", "a", "dojo-7")
    assert ended.epoch is None, "the owner would stand by for this service"


def test_after_a_split_the_owner_goes_on_with_the_movement_of_the_service_that_stands_down(stage, rival):
    stage.play("a")
    judgement = stage.judgement(lambda j: j.movement is None)
    stage.state = [0.5, 0.5], 0.05
    judgement = stage.judgement(lambda j: j.movement is not None)
    fields = {"id": "dojo-7", "label": "lunging", "began_ns": 7_000_000, "decided_ns": judgement.at_ns}
    end = rival(judgement, 0, judgement.movement.model_copy(update=fields))
    stage.judgement(lambda j: j.fusion == "a" and j.movement is not None and j.movement.id == "dojo-7")
    end()
    stage.state = REST
    assert [(v.id, v.label, v.stage) for v in stage.verdicts()] == [("dojo-7", "lunging", "ended")]
    # Late copies do not begin it again.
    rival(judgement, 0, judgement.movement.model_copy(update=fields))
    last = stage.judgement(lambda j: j.fusion == "a" and j.movement is None)
    assert all(j.movement is None for j in stage.judgements(lambda j: j.seq > last.seq + 20) if j.fusion == "a")


def test_after_a_split_the_owner_names_its_own_id_at_the_end_of_a_movement_that_was_over_for_it(stage, rival):
    """The other half saw it for longer. Who knows the owner's id knows its end; the other id is no movement."""
    stage.play("a")
    stage.decide()
    stage.state = REST
    ended = stage.verdicts(lambda v: v.ended_ns is not None)[-1]
    judgement = stage.judgement(lambda j: j.movement is None and j.at_ns > ended.at_ns)
    began_ns = ended.began_ns + 5_000_000
    fields = {"id": f"dojo-{began_ns // 1_000_000}", "label": "bowing", "began_ns": began_ns}
    rival(judgement, 0, OngoingMovement(decided_ns=ended.decided_ns, **fields))
    (other,) = stage.verdicts(lambda v: v.id == fields["id"])
    assert (other.stage, other.fusion, other.same_as) == ("ended", "a", ended.id)


def test_after_a_split_the_owner_says_once_which_ids_were_one_movement_that_has_ended(stage, rival):
    stage.play("a")
    stage.decide()
    stage.state = REST
    ended = stage.verdicts(lambda v: v.ended_ns is not None)[-1]
    judgement = stage.judgement(lambda j: j.fusion == "a" and j.movement is None)
    rival(judgement, 0, None)
    publisher = stage.mesh.peer("verdicts").publisher(stage.keys.verdict)
    fields = {"fusion": "b", "session": "rival", "epoch": 0}
    others = [ended.model_copy(update={**fields, "id": f"dojo-{n}", "label": n}) for n in ("lunging", "bowing")]

    def repeat(stop):
        while not stop.wait(0.02):
            for other in others:
                publisher.put(encode(other))

    stage.mesh.run(repeat)
    same = stage.verdicts(lambda v: v.same_as is not None)
    same += [*stage.verdicts(), *stage.verdicts()]
    said = [(v.id, v.same_as, v.fusion, v.ended_ns) for v in same if v.same_as is not None]
    assert said == [("dojo-bowing", ended.id, "a", ended.ended_ns)]


def test_of_two_processes_with_one_id_that_stand_by_one_ends_before_it_is_too_late(stage, monkeypatch):
    monkeypatch.setattr("fusion.same_id.IdCheck.is_free", lambda *_: True)
    monkeypatch.setattr("fusion.same_id.ASK_EVERY_S", 0.05)
    stage.begin("a")
    stage.judgement(lambda j: j.fusion == "a")
    stage.begin("b")
    stage.begin("b2", own="b")
    until(lambda: stage.same_ids)
    assert len(stage.same_ids) == 1 and "fusion/b/" in str(stage.same_ids[0])
    stage.same_ids.clear()
    stage.end("a")
    stage.judgement(lambda j: j.fusion == "b")
