"""Two fusion services and an observer with a wrong clock, between real Zenoh peers."""

import json
import threading
import time
from functools import partial

import pytest
import zenoh
from mesh_stage import LOOPBACK, NAMED, SOON_S, posterior

from common import SECOND_NS
from common.config import MeshConfig, read_scene
from common.link import Link
from common.messages import JudgementMessage, StatusMessage, VerdictMessage, VocabularyReference
from common.status import ProcessStatus, StatusPublisher
from common.vocabulary import Vocabulary
from common.wire import decode
from fusion.membership import SameIdError
from fusion.server import SteadyClock, serve

HOUR_NS = 3600 * SECOND_NS
REST, BOWING = ([0.5, 0.5], 0.95), ([0.98, 0.02], 0.05)


@pytest.fixture
def scene(tmp_path):
    text = (
        f'scene = "dojo"\n{NAMED}{LOOPBACK}[observers.cam1]\nsource = "m.npz"\n'
        '[fusion]\nid = "a"\nstandby = ["b"]\nhold_s = 0.1\ntakeover_s = 0.3\n'
    )
    (tmp_path / "s.toml").write_text(text)
    return read_scene(tmp_path / "s.toml", {})


@pytest.fixture
def hall(scene):
    made = Hall(scene)
    yield made
    made.close()


class Hall:
    """A mesh in one process: services that can be ended one by one, one observer, one who listens."""

    def __init__(self, scene):
        self.scene, self.keys = scene, scene.keys
        self.meeting = Link.open(scene.mesh, "fusion")
        self.mesh = MeshConfig(mode="process", endpoint=self.meeting.locator)
        self.links, self.services, self.clocks, self.faults = [self.meeting], {}, {}, []
        self.camera, self.hub = self.peer("observer"), self.peer("hub")
        self.mouth = self.camera.publisher(self.keys.posterior("cam1"))
        self.judgements, self.verdicts = self.hub.inbox(self.keys.judgement), self.hub.inbox(self.keys.verdict)
        self.seq, self.skew_ns = 0, 0
        self.talking, self.belief, self.quiet = None, REST, threading.Event()

    def peer(self, role):
        self.links.append(Link.open(self.mesh, role))
        return self.links[-1]

    def begin(self, service, own="", steady=False):
        """Start one more fusion service."""
        link, stop = self.peer("standby"), threading.Event()
        self.clocks[service] = ticking = threading.Event()
        ticking.set()

        def clock():
            ticking.wait()
            return time.time_ns()

        def body():
            try:
                serve([self.scene], own or service, link, stop, None if steady else clock)
            except Exception as error:  # noqa: BLE001 - asserted when the hall closes
                self.faults.append(error)

        thread = threading.Thread(target=body)
        thread.start()
        self.services[service] = (stop, thread, link)

    def end(self, service):
        """Its process ends: the link closes with it."""
        stop, thread, link = self.services.pop(service)
        stop.set()
        self.clocks[service].set()
        thread.join(SOON_S)
        link.close()

    def freeze(self, service):
        """Its loop hangs in the middle, and its link stays open: no liveliness token disappears."""
        self.clocks[service].clear()

    def talk(self):
        """The observer says what it believes 50 times a second until the hall closes."""

        def body():
            while not self.quiet.wait(0.02):
                p, rest = self.belief
                now_ns = time.time_ns() + self.skew_ns
                payload = posterior(seq=self.seq, captured_ns=now_ns, sent_ns=now_ns, p=p, rest=rest)
                self.seq += 1
                self.mouth.put(payload)

        self.talking = threading.Thread(target=body)
        self.talking.start()

    def close(self):
        self.quiet.set()
        if self.talking:
            self.talking.join(SOON_S)
        for service in list(self.services):
            self.end(service)
        for link in self.links:
            link.close()
        assert self.faults == []


def until(inbox, kind, enough):
    """Messages of one kind, until `enough(message)` holds for the newest."""
    heard, end_s = [], time.monotonic() + SOON_S
    while time.monotonic() < end_s:
        for arrival in inbox.take(0.1):
            heard.append(decode(kind, arrival.payload))
            if enough(heard[-1]):
                return heard
    raise AssertionError(f"not among {len(heard)}: {heard[-1:]}")


def test_one_speaks_and_the_other_goes_on_with_the_same_movement(hall):
    hall.begin("a")
    hall.begin("b")
    hall.talk()
    until(hall.judgements, JudgementMessage, lambda j: j.fusion == "a" and j.votes["cam1"].state == "counted")
    hall.belief = BOWING
    decided = until(hall.verdicts, VerdictMessage, lambda v: True)[-1]
    assert (decided.label, decided.fusion, decided.ended_ns) == ("bowing", "a", None)
    until(hall.judgements, JudgementMessage, lambda j: j.movement is not None and j.movement.label == "bowing")
    hall.end("a")
    before = time.monotonic()
    first = until(hall.judgements, JudgementMessage, lambda j: j.fusion == "b")[-1]
    assert time.monotonic() - before < 1
    assert first.movement.id == decided.id and first.movement.label == "bowing"
    hall.belief = REST
    ended = until(hall.verdicts, VerdictMessage, lambda v: v.ended_ns is not None)
    assert [(v.id, v.fusion) for v in ended] == [(decided.id, "b")]


def test_what_happens_while_the_leader_is_silent_is_said_when_another_leads(hall):
    hall.begin("a")
    hall.begin("b")
    hall.talk()
    until(hall.judgements, JudgementMessage, lambda j: j.fusion == "a" and j.votes["cam1"].state == "counted")
    statuses = hall.hub.inbox(hall.keys.fusion_status("b"))
    until(statuses, StatusMessage, lambda s: s.reason == "standing by for a")
    hall.belief = BOWING
    decided = until(hall.verdicts, VerdictMessage, lambda v: True)[-1]
    hall.freeze("a")
    hall.belief = REST  # the movement is over a tenth of a second from now, and nobody leads for three
    ended = until(hall.verdicts, VerdictMessage, lambda v: True)[-1]
    first = until(hall.judgements, JudgementMessage, lambda j: j.fusion == "b")[-1]
    assert (ended.id, ended.fusion) == (decided.id, "b") and ended.ended_ns is not None
    assert ended.at_ns <= first.at_ns and first.movement is None


def test_the_one_who_stands_by_says_so_and_nothing_else(hall):
    hall.begin("a")
    until(hall.judgements, JudgementMessage, lambda j: j.fusion == "a")
    statuses = hall.hub.inbox(hall.keys.fusion_status("b"))
    hall.begin("b")
    until(statuses, StatusMessage, lambda s: s.state == "running" and s.reason == "standing by for a")
    said = until(hall.judgements, JudgementMessage, lambda j: j.seq > 30)
    assert {j.fusion for j in said} == {"a"}


def test_who_comes_late_is_told_the_last_verdicts_by_whoever_leads(hall):
    hall.begin("a")
    hall.begin("b")
    hall.talk()
    until(hall.judgements, JudgementMessage, lambda j: j.votes["cam1"].state == "counted")
    for _ in range(2):
        hall.belief = BOWING
        until(hall.verdicts, VerdictMessage, lambda v: v.ended_ns is None)
        hall.belief = REST
        until(hall.verdicts, VerdictMessage, lambda v: v.ended_ns is not None)
    hall.end("a")
    until(hall.judgements, JudgementMessage, lambda j: j.fusion == "b")
    told = [decode(VerdictMessage, p) for key, p in hall.peer("hub").ask_each(hall.keys.verdict, SOON_S)]
    assert [v.ended_ns is None for v in told] == [True, False, True, False]
    assert [v.decided_ns for v in told] == sorted(v.decided_ns for v in told)


def test_two_services_of_one_id_are_a_mistake(hall, monkeypatch):
    monkeypatch.setattr("fusion.server.SAME_ID_TIMEOUT_S", 0.5)
    hall.begin("a")
    until(hall.judgements, JudgementMessage, lambda j: j.fusion == "a")
    with pytest.raises(SameIdError, match="alive already; stop it, or give this one an id of its own"):
        serve([hall.scene], "a", hall.peer("standby"), threading.Event())


@pytest.mark.parametrize("skew_ns", [HOUR_NS, -HOUR_NS])
def test_an_observer_an_hour_off_is_heard_as_what_it_is_and_its_skew_is_told(hall, skew_ns):
    hall.skew_ns = skew_ns
    health = ProcessStatus("dojo", "cam1")
    with StatusPublisher(hall.camera, hall.keys.observer_status("cam1"), health, lambda: time.time_ns() + skew_ns):
        statuses = hall.hub.inbox(hall.keys.fusion_status("a"))
        hall.begin("a")
        hall.talk()
        counted = until(hall.judgements, JudgementMessage, lambda j: j.votes["cam1"].skew_s is not None)[-1]
        assert counted.votes["cam1"].skew_s == pytest.approx(skew_ns / 1e9, abs=0.2)
        vote = until(hall.judgements, JudgementMessage, lambda j: j.votes["cam1"].state == "counted")[-1].votes["cam1"]
        assert 0 <= vote.age_s < 0.2
        told = until(statuses, StatusMessage, lambda s: s.observers and s.observers["cam1"].skew_s is not None)[-1]
        assert told.observers["cam1"].skew_s == pytest.approx(skew_ns / 1e9, abs=0.2)
        hall.belief = BOWING
        assert until(hall.verdicts, VerdictMessage, lambda v: True)[-1].label == "bowing"


def test_bad_messages_are_told_in_the_status_by_observer_and_reason(hall):
    hall.begin("a")
    until(hall.judgements, JudgementMessage, lambda j: j.fusion == "a")
    statuses = hall.hub.inbox(hall.keys.fusion_status("a"))
    assert hall.mouth.wait_for_subscriber(SOON_S)
    hall.mouth.put(b"\xc1")
    foreign = zenoh.Config()
    for key, value in {"mode": "client", "connect/endpoints": [hall.mesh.endpoint]}.items():
        foreign.insert_json5(key, json.dumps(value))
    with zenoh.open(foreign) as session:
        # Ours would drop what does not fit through at once; a stranger may insist.
        block = zenoh.CongestionControl.BLOCK
        session.put(hall.keys.posterior("cam1"), bytes(500_000), congestion_control=block)
    hall.peer("observer").publisher(hall.keys.posterior("mallory")).put(b"\xc1")
    wanted = {"not_msgpack": 1, "too_large": 1}
    told = until(statuses, StatusMessage, lambda s: s.observers and s.observers["cam1"].rejected == wanted)[-1]
    assert set(told.observers) <= {"cam1", "mallory"}


def test_a_lone_service_continues_after_a_restart(hall, tmp_path):
    fusion = hall.scene.fusion.model_copy(update={"standby": (), "memory": str(tmp_path / "memory.json")})
    hall.scene = hall.scene.model_copy(update={"fusion": fusion})
    hall.begin("a")
    hall.talk()
    until(hall.judgements, JudgementMessage, lambda j: j.votes["cam1"].state == "counted")
    hall.belief = BOWING
    decided = until(hall.verdicts, VerdictMessage, lambda v: True)[-1]
    until(hall.judgements, JudgementMessage, lambda j: j.movement is not None and j.movement.label is not None)
    hall.end("a")
    hall.begin("a")
    until(hall.judgements, JudgementMessage, lambda j: j.movement is not None and j.movement.id == decided.id)
    hall.belief = REST
    ended = until(hall.verdicts, VerdictMessage, lambda v: True)
    assert [(v.id, v.ended_ns is not None) for v in ended] == [(decided.id, True)]


def test_a_clock_that_is_set_back_within_a_movement_changes_no_verdict(hall, monkeypatch):
    jump_ns = 0
    real = time.time_ns
    steady = partial(SteadyClock, lambda: real() + jump_ns)
    monkeypatch.setattr("fusion.server.SteadyClock", steady)
    hall.begin("a", steady=True)
    hall.talk()
    until(hall.judgements, JudgementMessage, lambda j: j.votes["cam1"].state == "counted")
    hall.belief = BOWING
    decided = until(hall.verdicts, VerdictMessage, lambda v: True)[-1]
    jump_ns = -HOUR_NS
    until(hall.judgements, JudgementMessage, lambda j: j.seq > decided.seq + 20)
    hall.belief = REST
    ended = until(hall.verdicts, VerdictMessage, lambda v: True)
    assert [(v.id, v.ended_ns is not None) for v in ended] == [(decided.id, True)]
    until(hall.judgements, JudgementMessage, lambda j: j.at_ns < real() - HOUR_NS / 2)


def test_of_two_processes_with_one_id_that_start_together_one_ends(hall, monkeypatch):
    monkeypatch.setattr("fusion.server._id_is_free", lambda *_: True)
    fusion = hall.scene.fusion.model_copy(update={"standby": ()})
    hall.scene = hall.scene.model_copy(update={"fusion": fusion})
    hall.begin("a")
    hall.begin("a2", own="a")
    end_s = time.monotonic() + SOON_S
    while not hall.faults:
        assert time.monotonic() < end_s, "both publish"
        hall.judgements.take(0.1)
    (fault,) = hall.faults
    assert isinstance(fault, SameIdError)
    hall.faults.clear()
    survivor = until(hall.judgements, JudgementMessage, lambda j: j.seq > 10)[-1].session
    said = until(hall.judgements, JudgementMessage, lambda j: j.seq > 40)
    assert {j.session for j in said} == {survivor}


def test_judgements_of_many_observers_fit_and_the_standby_service_stands_by(hall, tmp_path):
    """40 observers of 200 movements: with each vote's p a judgement would have 75 kB, and nobody could read it."""
    vocabulary = Vocabulary(tuple(f"movement_{n}" for n in range(200)), "many")
    observers = {f"cam{n}": hall.scene.observer("cam1") for n in range(40)}
    changes = {"observers": observers, "vocabulary": vocabulary.labels, "vocabulary_name": vocabulary.name}
    hall.scene = hall.scene.model_copy(update=changes)
    fields = {
        "vocabulary": VocabularyReference(name=vocabulary.name, hash=vocabulary.digest),
        "p": [0.801, *[0.001] * 199],
    }
    hall.begin("a")
    until(hall.judgements, JudgementMessage, lambda j: j.fusion == "a")
    hall.begin("b")
    statuses = hall.hub.inbox(hall.keys.fusion_status("b"))
    publishers = {name: hall.camera.publisher(hall.keys.posterior(name)) for name in observers}
    for seq in range(20):
        for name, publisher in publishers.items():
            publisher.put(posterior(name, seq, **fields))
        hall.quiet.wait(0.05)
    judgements = until(hall.judgements, JudgementMessage, lambda j: j.agreement.n > 30)
    assert all(vote.p is None for vote in judgements[-1].votes.values()) and judgements[-1].label == "movement_0"
    until(statuses, StatusMessage, lambda s: s.reason == "standing by for a")
    assert {j.fusion for j in until(hall.judgements, JudgementMessage, lambda j: j.seq > judgements[-1].seq + 10)} == {
        "a"
    }
