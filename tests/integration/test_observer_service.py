"""The loop of an observer between real Zenoh peers, with a fake source and a fake pipeline."""

import threading
from dataclasses import dataclass, field

import numpy as np
import pytest

from common.config import MeshConfig, read_scene
from common.errors import BadInput
from common.link import Link
from common.messages import (
    PosteriorMessage,
    StatusMessage,
    VocabularyReference,
)
from common.vocabulary import Vocabulary
from common.wire import decode
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


def collect(inbox, kind, enough):
    """Messages of `kind` until `enough(messages)` holds."""
    messages = []
    while not enough(messages):
        arrivals = inbox.take(SOON_S)
        assert arrivals, f"only {len(messages)} came: {messages[-3:]}"
        messages += [decode(kind, arrival.payload) for arrival in arrivals]
    return messages


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
