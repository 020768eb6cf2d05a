"""The loop of an observer between real Zenoh peers, with a source that the test feeds and a fake pipeline."""

import threading

import pytest
from mesh_stage import LOOPBACK, NAMES, REFERENCE, FakePipeline, believed, collect, first
from processes import SOON_S, until

from common.config import read_scene
from common.errors import BadInput
from common.message_types import BodyRegionShares
from common.messages import PosteriorMessage, StatusMessage, VocabularyMessage
from common.vocabulary import Vocabulary
from common.wire import decode
from observer.runtime.service import serve
from observer.tracks import Frame


class FedSource:
    """Yields a frame for each content that is offered; a text ends it."""

    rate_hz = 10.0
    body_parts = ("head",)

    def __init__(self, *contents):
        self._contents, self._condition = list(contents), threading.Condition()

    def offer(self, *contents):
        with self._condition:
            self._contents += contents
            self._condition.notify_all()

    def frames(self, stop):
        captured_ns = 1000
        while not stop.is_set():
            with self._condition:
                self._condition.wait_for(lambda: self._contents, 0.05)
                offered, self._contents = self._contents, []
            for content in offered:
                if isinstance(content, str):
                    return
                captured_ns += 1
                yield Frame(captured_ns, content)


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "s.toml").write_text(f'scene = "dojo"\n{LOOPBACK}[observers.cam1]\nsource = "m.npz"\n')
    return read_scene(tmp_path / "s.toml", {})


@pytest.fixture
def link(mesh, scene):
    """The observer's link, once it has met the one that listens."""
    mesh.posteriors = mesh.meeting.inbox(scene.keys.posterior())
    mesh.statuses = mesh.meeting.inbox(scene.keys.observer_status())
    opened = mesh.peer("observer")
    assert opened.publisher(scene.keys.posterior("cam1")).wait_for_subscriber(SOON_S)
    return opened


def test_a_posterior_is_published_after_each_frame(scene, mesh, link):
    presence, source = mesh.meeting.presence(scene.keys.observer_alive()), FedSource()
    _, thread = mesh.run(serve, scene, "cam1", FakePipeline(), source, link)
    assert presence.wait_for(1, SOON_S) and presence.alive == {scene.keys.observer_alive("cam1")}
    source.offer(believed((0.25, 0.75), 0.25, {"head": True}), None, believed((1.0, 0.0)), "end")
    messages = collect(mesh.posteriors, PosteriorMessage, lambda messages: len(messages) == 2)
    assert [(m.seq, m.captured_ns, m.p) for m in messages] == [(0, 1001, [0.25, 0.75]), (1, 1003, [1.0, 0.0])]
    assert messages[0].vocabulary.hash == REFERENCE.hash and messages[0].rest == 0.25 and messages[0].visible == {}
    assert messages[0].session == messages[1].session and messages[0].sent_ns <= messages[1].sent_ns
    thread.join(SOON_S)
    assert not thread.is_alive()


@pytest.mark.parametrize("slow", [False, True])
def test_the_end_of_the_source_is_the_end_of_the_movement(scene, mesh, link, slow):
    if slow:
        section = scene.observer("cam1").model_copy(update={"say": "on change"})
        scene = scene.model_copy(update={"observers": {"cam1": section}})
    presence = mesh.meeting.presence(scene.keys.observer_alive())
    pipeline = FakePipeline(at_end=believed((1.0, 0.0), 0.25))
    mesh.run(serve, scene, "cam1", pipeline, FedSource(believed((0.5, 0.5), 0.25), "end"), link)
    assert presence.wait_for(1, SOON_S)
    messages = collect(mesh.posteriors, PosteriorMessage, lambda messages: len(messages) == 2)
    assert [(m.captured_ns, m.p) for m in messages] == [(1001, [0.5, 0.5]), (1002, [1.0, 0.0])]
    assert presence.alive, "fusion uses what observers say that are there"


def test_an_observer_that_is_stopped_does_not_say_that_the_movement_has_ended(scene, mesh, link):
    source = FedSource(believed((0.5, 0.5), 0.25))
    stop, thread = mesh.run(serve, scene, "cam1", FakePipeline(at_end=believed((1.0, 0.0))), source, link)
    collect(mesh.posteriors, PosteriorMessage)
    stop.set()
    thread.join(SOON_S)
    assert not thread.is_alive() and not mesh.posteriors.take(0)


def test_on_a_slow_line_only_what_has_changed_is_published(scene, mesh, link):
    slow = scene.model_copy(
        update={"observers": {"cam1": scene.observer("cam1").model_copy(update={"say": "on change"})}}
    )
    changes = ((0.25, 0.75), (0.255, 0.745), (0.25, 0.75), (0.5, 0.5), (0.5, 0.5), (0.75, 0.25))
    mesh.run(serve, slow, "cam1", FakePipeline(), FedSource(*(believed(p, 0.25) for p in changes), "end"), link)
    messages = collect(mesh.posteriors, PosteriorMessage, lambda messages: len(messages) == 3)
    assert [(m.seq, m.captured_ns, m.p[0]) for m in messages] == [(0, 1001, 0.25), (1, 1004, 0.5), (2, 1006, 0.75)]


def test_each_start_is_a_new_session(scene, mesh, link):
    sessions = set()
    for _ in range(2):
        _, thread = mesh.run(serve, scene, "cam1", FakePipeline(), FedSource(believed(), "end"), link)
        sessions |= {message.session for message in collect(mesh.posteriors, PosteriorMessage)}
        thread.join(SOON_S)
    assert len(sessions) == 2


def test_it_publishes_its_status(scene, mesh, link):
    source, pipeline = FedSource(), FakePipeline()
    pipeline.leans_on = BodyRegionShares(hash=NAMES.digest, regions=["trunk"], shares=[[100], [0]])
    stop, _ = mesh.run(serve, scene, "cam1", pipeline, source, link)
    assert collect(mesh.statuses, StatusMessage)[0].state == "starting"
    source.offer(believed())
    states = collect(mesh.statuses, StatusMessage, lambda messages: any(s.state != "starting" for s in messages))
    assert states[-1].last_frame_ns == 1001
    first(mesh.statuses, StatusMessage, lambda status: status.leans_on == pipeline.leans_on)
    stop.set()
    assert collect(mesh.statuses, StatusMessage, lambda messages: messages and messages[-1].state == "stopping")


def test_it_publishes_why_it_failed(scene, mesh, link):
    def fail(frame):
        raise BadInput("camera file of 1999")

    with pytest.raises(BadInput):
        serve(scene, "cam1", FakePipeline(fail), FedSource(believed()), link, threading.Event())
    last = collect(mesh.statuses, StatusMessage, lambda messages: messages and messages[-1].state == "failed")[-1]
    assert last.reason == "BadInput: camera file of 1999"


def test_an_observer_without_a_model_is_silent_and_publishes_in_each_vocabulary_that_it_gets(scene, mesh, link):
    """As when it is taught while it runs."""
    pipeline, source, taught = FakePipeline(), FedSource(), Vocabulary(("clap", "point", "wave"))
    pipeline.vocabulary, pipeline.step = None, lambda _: None
    mesh.run(serve, scene, "cam1", pipeline, source, link)
    source.offer(None)
    until(lambda: first(mesh.statuses, StatusMessage, lambda status: status.state == "running"))
    assert mesh.meeting.ask(scene.keys.vocabulary, 0.1) == {}
    for vocabulary, p in ((taught, (0.8, 0.1, 0.1)), (NAMES, (0.1, 0.9))):
        pipeline.step, pipeline.vocabulary = lambda _, p=p: believed(p), vocabulary
        source.offer(None)
        (message,) = collect(mesh.posteriors, PosteriorMessage)
        assert (message.vocabulary.hash, len(message.p)) == (vocabulary.digest, len(p))
        answer = mesh.meeting.ask(scene.keys.vocabulary, SOON_S)[scene.keys.vocabulary]
        assert decode(VocabularyMessage, answer).vocabulary == vocabulary
