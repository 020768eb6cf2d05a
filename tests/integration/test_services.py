"""The loops of observer and fusion between real Zenoh peers, with a fake observer and a fake referee."""

import threading
from collections import Counter
from dataclasses import dataclass, field

import msgpack
import numpy as np
import pytest

from common.config import MeshConfig, read_scene
from common.errors import BadInput
from common.link import Link
from common.messages import (
    Agreement,
    JudgementMessage,
    PosteriorMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
    VocabularyReference,
)
from common.vocabulary import Vocabulary
from common.wire import decode, encode
from fusion.complaints import MINUTE_NS, Complaints
from fusion.service import known_vocabulary
from fusion.service import serve as serve_fusion
from observer.runtime.service import serve as serve_observer
from observer.tracks import Frame

SOON_S = 10.0
NAMES = Vocabulary(("bowing", "lunging"), "karate")
REFERENCE = VocabularyReference(name=NAMES.name, hash=NAMES.digest)


@dataclass
class Opinion:
    p: np.ndarray
    rest: float = 0.25
    frames: int = 1
    visible: dict = field(default_factory=lambda: {"head": True})
    unlearned: float | None = None
    facing: np.ndarray | None = None
    facets: dict = field(default_factory=dict)


class FakeObserver:
    vocabulary = NAMES
    complaint = ""

    def step(self, frame):
        return None if frame.content is None else Opinion(frame.content)


class FakeSource:
    """Gives a frame for each that is offered, until it ends."""

    rate_hz = 10.0
    body_parts = ("head",)

    def __init__(self):
        self._offered, self._condition = [], threading.Condition()

    def offer(self, *contents):
        with self._condition:
            self._offered += contents
            self._condition.notify_all()

    def frames(self, stop):
        captured_ns = 1000
        while not stop.is_set():
            with self._condition:
                self._condition.wait_for(lambda: self._offered, 0.05)
                taken, self._offered = self._offered, []
            for content in taken:
                if isinstance(content, str):
                    return
                captured_ns += 1
                yield Frame(captured_ns, content)


@dataclass
class Ruling:
    judgement: JudgementMessage
    verdicts: list


class FakeReferee:
    """Judges as the last voice said, and decides whenever it heard something new."""

    vocabulary = NAMES

    def __init__(self):
        self.heard, self.rejected, self.alive, self.steps = [], Counter(), frozenset(), 0
        self.clocks, self.continued = {}, []
        self.changed = threading.Condition()

    def receive(self, observer, message, now_ns):
        if message.session == "old":
            return "past_session"
        with self.changed:
            self.heard.append((observer, message.seq))
            self.changed.notify_all()
        return None

    def reject(self, observer, reason):
        with self.changed:
            self.rejected[observer, reason] += 1
            self.changed.notify_all()

    def set_present(self, observers):
        with self.changed:
            self.alive = observers
            self.changed.notify_all()

    def record_clock(self, observer, reading):
        with self.changed:
            self.clocks[observer] = reading.skew_ns / 1e9
            self.changed.notify_all()

    def skew_s(self, observer):
        return self.clocks.get(observer)

    def continue_from(self, judgement):
        self.continued.append(judgement)

    def step(self, now_ns):
        with self.changed:
            self.steps += 1
            self.changed.notify_all()
        if not self.heard:
            return None
        said = {
            "scene": "dojo", "fusion": "fusion", "seq": self.steps, "at_ns": now_ns, "vocabulary": REFERENCE,
            "p": [0.5, 0.5], "label": "bowing", "certainty_bits": 1.0, "rule": "log", "votes": {},
            "agreement": Agreement(k=1, n=1),
        }  # fmt: skip
        verdict = VerdictMessage(**said, id=f"v{len(self.heard)}", began_ns=1, decided_ns=2)
        return Ruling(JudgementMessage(**said), [verdict])

    def wait_for(self, condition):
        with self.changed:
            assert self.changed.wait_for(condition, SOON_S)


@pytest.fixture
def scene(tmp_path):
    text = 'scene = "dojo"\n[mesh]\nmode = "process"\nendpoint = "tcp/127.0.0.1:0"\n'
    text += "".join(f'[observers.cam{i}]\nsource = "m.npz"\n' for i in (1, 2))
    (tmp_path / "s.toml").write_text(text + "[fusion]\nstep_hz = 50\n")
    return read_scene(tmp_path / "s.toml", {})


@pytest.fixture
def meeting(scene):
    with Link.open(scene.mesh, "fusion") as link:
        yield link


@pytest.fixture
def peer(meeting):
    mesh = MeshConfig(mode="process", endpoint=meeting.locator)
    links = []

    def another(role="hub"):
        links.append(Link.open(mesh, role))
        return links[-1]

    yield another
    for link in links:
        link.close()


@pytest.fixture
def running():
    """Run a service in a thread; its failure is the test's."""
    stops, threads, faults = [], [], []

    def run(serve, *arguments):
        stop = threading.Event()

        def body():
            try:
                serve(*arguments, stop)
            except Exception as error:  # noqa: BLE001 - told to the test below
                faults.append(error)

        threads.append(threading.Thread(target=body))
        stops.append(stop)
        threads[-1].start()
        return stop, threads[-1]

    yield run
    for stop in stops:
        stop.set()
    for thread in threads:
        thread.join(SOON_S)
        assert not thread.is_alive()
    assert faults == []


@pytest.fixture
def referee(scene, meeting, running):
    fake = FakeReferee()
    running(serve_fusion, scene, fake, meeting)
    return fake


def posterior(observer="cam1", seq=0, **fields):
    said = {
        "scene": "dojo", "observer": observer, "seq": seq, "session": "s", "captured_ns": 1, "sent_ns": 2,
        "vocabulary": REFERENCE, "p": [0.5, 0.5], "frames": 1,
    }  # fmt: skip
    return encode(PosteriorMessage(**{**said, **fields}))


def collect(inbox, kind, enough):
    """Messages of `kind` until `enough(messages)` holds."""
    messages = []
    while not enough(messages):
        arrivals = inbox.take(SOON_S)
        assert arrivals, f"only {len(messages)} came: {messages[-3:]}"
        messages += [decode(kind, arrival.payload) for arrival in arrivals]
    return messages


def test_posteriors_become_judgements_and_verdicts(referee, peer, scene):
    keys = scene.keys
    hub, cam = peer(), peer("observer")
    judgements, verdicts = hub.inbox(keys.judgement), hub.inbox(keys.verdict)
    mouth = cam.publisher(keys.posterior("cam1"))
    assert mouth.wait_for_subscriber(SOON_S)
    for seq in range(5):
        mouth.put(posterior(seq=seq))
    referee.wait_for(lambda: len(referee.heard) == 5)
    assert referee.heard == [("cam1", seq) for seq in range(5)]
    assert collect(judgements, JudgementMessage, bool)[0].scene == "dojo"
    assert collect(verdicts, VerdictMessage, lambda said: said and said[-1].id == "v5")


def test_it_judges_even_when_nothing_comes(referee):
    steps = referee.steps
    referee.wait_for(lambda: referee.steps >= steps + 3)


def test_bad_messages_are_counted_and_the_loop_goes_on(referee, peer, scene, caplog):
    cam = peer("observer")
    mouth = cam.publisher(scene.keys.posterior("cam1"))
    assert mouth.wait_for_subscriber(SOON_S)
    bad = [
        b"\xc1",
        b"",
        posterior("cam2"),
        posterior(scene="garden"),
        posterior()[:-3],
        msgpack.packb([1]),
        b"x" * 70_000,
    ]
    for told, payload in enumerate(10 * bad, 1):
        mouth.put(payload)
        # One at a time: Zenoh drops what floods it, and this is about what arrives.
        referee.wait_for(lambda told=told: sum(referee.rejected.values()) == told)
    mouth.put(posterior(seq=1, session="old"))
    mouth.put(posterior(seq=9))
    referee.wait_for(lambda: ("cam1", 9) in referee.heard)
    assert referee.heard == [("cam1", 9)]
    assert referee.rejected == {
        ("cam1", "not_msgpack"): 30,
        ("cam1", "wrong_key"): 20,
        ("cam1", "not_a_map"): 10,
        ("cam1", "too_large"): 10,
    }
    assert sum("cam1: messages not used" in record.message for record in caplog.records) == 1


def test_the_referee_knows_who_is_alive(referee, peer, scene):
    one = peer("observer")
    one.announce(scene.keys.observer_alive("cam1"))
    peer("observer").announce(scene.keys.observer_alive("cam2"))
    referee.wait_for(lambda: referee.alive == {"cam1", "cam2"})
    one.close()
    referee.wait_for(lambda: referee.alive == {"cam2"})


def test_who_comes_late_gets_the_last_values(referee, peer, scene):
    keys = scene.keys
    early = peer()
    assert early.ask(keys.judgement, 0.1) == {}
    mouth = peer("observer").publisher(keys.posterior("cam1"))
    assert mouth.wait_for_subscriber(SOON_S)
    mouth.put(posterior())
    verdicts = early.inbox(keys.verdict)
    collect(verdicts, VerdictMessage, bool)
    told = peer().ask(f"{keys.root}/**", SOON_S)
    assert set(told) == {keys.judgement, keys.verdict, keys.vocabulary, keys.fusion_status("fusion")}
    assert decode(VerdictMessage, told[keys.verdict]).id == "v1"
    assert decode(VocabularyMessage, told[keys.vocabulary]).labels == ["bowing", "lunging"]
    assert decode(StatusMessage, told[keys.fusion_status("fusion")]).state == "running"


def test_fusion_is_alive_and_says_when_it_stops(scene, meeting, peer, running):
    hub = peer()
    presence = hub.presence(scene.keys.fusion_alive())
    statuses = hub.inbox(scene.keys.fusion_status())
    stop, thread = running(serve_fusion, scene, FakeReferee(), meeting)
    assert presence.wait_for(1, SOON_S)
    collect(statuses, StatusMessage, lambda said: len(said) >= 2)  # it is said again without being changed
    stop.set()
    thread.join(SOON_S)
    assert collect(statuses, StatusMessage, bool)[-1].state == "stopping"
    meeting.close()
    assert presence.wait_for(0, SOON_S)


def test_a_scene_without_vocabulary_takes_that_of_an_observer(scene, meeting, peer, running):
    source = FakeSource()
    running(serve_observer, scene, "cam1", FakeObserver(), source, peer("observer"))
    assert known_vocabulary(scene, meeting, threading.Event()) == NAMES
    source.offer("end")


def test_stop_ends_the_asking_for_a_vocabulary(scene, meeting):
    stop = threading.Event()
    stop.set()
    assert known_vocabulary(scene, meeting, stop) is None


def test_an_observer_says_what_it_believes_after_each_frame(scene, meeting, peer, running):
    keys, source = scene.keys, FakeSource()
    inbox = meeting.inbox(keys.posterior())
    presence = meeting.presence(keys.observer_alive())
    link = peer("observer")
    probe = link.publisher(keys.posterior("cam1"))
    assert probe.wait_for_subscriber(SOON_S)
    _, thread = running(serve_observer, scene, "cam1", FakeObserver(), source, link)
    assert presence.wait_for(1, SOON_S) and presence.alive == {keys.observer_alive("cam1")}
    source.offer(np.array([0.25, 0.75]), None, np.array([1.0, 0.0]), "end")
    said = collect(inbox, PosteriorMessage, lambda said: len(said) == 2)
    assert [message.seq for message in said] == [0, 1]
    assert [message.captured_ns for message in said] == [1001, 1003]
    assert [message.p for message in said] == [[0.25, 0.75], [1.0, 0.0]]
    assert said[0].vocabulary.hash == REFERENCE.hash and said[0].rest == 0.25 and said[0].visible == {}
    assert said[0].session == said[1].session and said[0].sent_ns <= said[1].sent_ns
    thread.join(SOON_S)
    assert not thread.is_alive()


def test_an_observer_on_a_slow_line_says_what_has_changed(scene, meeting, peer, running):
    slow = scene.model_copy(
        update={"observers": {"cam1": scene.observer("cam1").model_copy(update={"say": "on change"})}}
    )
    inbox, source, link = meeting.inbox(scene.keys.posterior()), FakeSource(), peer("observer")
    assert link.publisher(scene.keys.posterior("cam1")).wait_for_subscriber(SOON_S)
    running(serve_observer, slow, "cam1", FakeObserver(), source, link)
    beliefs = ((0.25, 0.75), (0.255, 0.745), (0.25, 0.75), (0.5, 0.5), (0.5, 0.5), (0.75, 0.25))
    source.offer(*map(np.array, beliefs), "end")
    said = collect(inbox, PosteriorMessage, lambda said: len(said) == 3)
    assert [(message.seq, message.captured_ns, message.p[0]) for message in said] == [
        (0, 1001, 0.25), (1, 1004, 0.5), (2, 1006, 0.75)
    ]  # fmt: skip


def test_each_start_is_a_new_session(scene, meeting, peer, running):
    inbox = meeting.inbox(scene.keys.posterior())
    link = peer("observer")
    assert link.publisher(scene.keys.posterior("cam1")).wait_for_subscriber(SOON_S)
    sessions = set()
    for _ in range(2):
        source = FakeSource()
        _, thread = running(serve_observer, scene, "cam1", FakeObserver(), source, link)
        source.offer(np.array([0.5, 0.5]), "end")
        sessions |= {message.session for message in collect(inbox, PosteriorMessage, bool)}
        thread.join(SOON_S)
    assert len(sessions) == 2


def test_an_observer_says_how_it_is(scene, meeting, peer, running):
    statuses = meeting.inbox(scene.keys.observer_status())
    link, source = peer("observer"), FakeSource()
    assert link.publisher(scene.keys.observer_status("cam1")).wait_for_subscriber(SOON_S)
    stop, _ = running(serve_observer, scene, "cam1", FakeObserver(), source, link)
    assert collect(statuses, StatusMessage, bool)[0].state == "starting"
    source.offer(np.array([0.5, 0.5]))
    states = collect(statuses, StatusMessage, lambda said: any(s.state != "starting" for s in said))
    assert states[-1].last_frame_ns == 1001
    stop.set()
    assert collect(statuses, StatusMessage, lambda said: said and said[-1].state == "stopping")


def test_a_failing_observer_says_so(scene, meeting, peer):
    class Broken(FakeObserver):
        def step(self, frame):
            raise BadInput("camera file of 1999")

    statuses = meeting.inbox(scene.keys.observer_status())
    link, source = peer("observer"), FakeSource()
    assert link.publisher(scene.keys.observer_status("cam1")).wait_for_subscriber(SOON_S)
    source.offer(np.array([0.5, 0.5]))
    with pytest.raises(BadInput):
        serve_observer(scene, "cam1", Broken(), source, link, threading.Event())
    last = collect(statuses, StatusMessage, lambda said: said and said[-1].state == "failed")[-1]
    assert last.reason == "BadInput: camera file of 1999"


def test_complaints_are_told_once_a_minute_and_counted():
    complaints = Complaints()
    assert "cam1: messages not used since last told: malformed 1; newest: d" in complaints.note(
        "cam1", "malformed", "d", 0
    )
    assert complaints.note("cam1", "malformed", "d", MINUTE_NS - 1) is None
    assert complaints.note("cam2", "malformed", "d", 1) is not None
    told = complaints.note("cam1", "not_finite", "e", MINUTE_NS)
    assert "malformed 1, not_finite 1; newest: e" in told


def test_invented_names_do_not_fill_the_memory():
    complaints = Complaints()
    lines = [complaints.note(f"x{i}", "malformed", "d", 0) for i in range(1000)]
    assert sum(line is not None for line in lines) == 257
