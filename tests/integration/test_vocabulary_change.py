"""Observers that change their vocabulary while everything runs: fusion services, late joiners and listeners follow."""

from dataclasses import replace
from functools import partial

import pytest
from mesh_stage import LOOPBACK, posterior
from processes import until

from common.config import read_scene
from common.message_checks import check_vocabulary
from common.message_types import MovementTimes
from common.messages import JudgementMessage, VerdictMessage, VocabularyMessage, VocabularyReference
from common.vocabulary import Vocabulary
from common.wire import decode, encode_vocabulary
from fusion.server import serve
from hub.session import SceneListener

OLD, NEW = Vocabulary(("bowing", "lunging")), Vocabulary(("clap", "point", "wave"))
KNOWN = {vocabulary.digest: vocabulary for vocabulary in (OLD, NEW)}
CAMERAS = ("cam1", "cam2", "cam3")
RATE_HZ = 50


@pytest.fixture
def scene(tmp_path, request):
    text = f'scene = "dojo"\n{getattr(request, "param", "")}{LOOPBACK}'
    text += "".join(f'[observers.{name}]\nsource = "m.npz"\n' for name in CAMERAS)
    text += '[fusion]\nid = "a"\nstandby = ["b"]\nhold_s = 0.05\ntakeover_s = 0.6\nstep_hz = 50\ndrop_s = 0.4\n'
    (tmp_path / "s.toml").write_text(text)
    return read_scene(tmp_path / "s.toml", {})


class MovingObserver:
    """Publishes a movement, sure of its vocabulary's first label, RATE_HZ times a second until the test ends."""

    def __init__(self, mesh, scene, name, vocabulary=OLD):
        self.seq, self.rest = 0, 0.05
        self.link, self.name, self.vocabulary = mesh.peer("observer"), name, vocabulary
        self.publisher = self.link.publisher(scene.keys.posterior(name))
        self.link.answer(scene.keys.vocabulary, lambda: encode_vocabulary("dojo", self.vocabulary))
        self.link.announce(scene.keys.observer_alive(name))
        self.publish()
        mesh.run(self._go_on)

    def publish(self):
        vocabulary = self.vocabulary
        p = [0.98] + [0.02 / (vocabulary.size - 1)] * (vocabulary.size - 1)
        reference = VocabularyReference(name="", hash=vocabulary.digest)
        self.publisher.put(posterior(self.name, self.seq, p=p, vocabulary=reference, rest=self.rest))

    def _go_on(self, stop):
        while not stop.wait(1 / RATE_HZ):
            self.seq += 1
            self.publish()


class Heard:
    """Everything that a hub receives, in order of arrival."""

    def __init__(self, mesh, scene):
        link, self.keys = mesh.peer(), scene.keys
        self._inbox, self.messages = link.inbox(scene.keys.verdict, scene.keys.judgement, scene.keys.vocabulary), []

    def until(self, fits):
        def found():
            for key, payload, _ in self._inbox.take(0.05):
                kinds = {self.keys.verdict: VerdictMessage, self.keys.vocabulary: VocabularyMessage}
                self.messages.append(decode(kinds.get(key, JudgementMessage), payload))
            return next((each for each in reversed(self.messages) if fits(each)), None)

        return until(found)

    @property
    def verdicts(self):
        return [message for message in self.messages if isinstance(message, VerdictMessage)]


def is_judged_in(vocabulary, label):
    return lambda m: isinstance(m, JudgementMessage) and m.vocabulary.hash == vocabulary.digest and m.label == label


def test_all_follow_within_a_second_and_no_verdict_mixes_vocabularies(mesh, scene):
    heard, cameras = Heard(mesh, scene), [MovingObserver(mesh, scene, name) for name in CAMERAS]
    owner, _ = mesh.run(partial(serve, [scene], "a", mesh.peer("standby")))
    mesh.run(partial(serve, [scene], "b", mesh.peer("standby")))
    with SceneListener(scene, mesh.peer(), lambda _: None) as listener:
        assert heard.until(lambda m: isinstance(m, VerdictMessage)).label == "bowing"
        # One observer alone changes nothing.
        cameras[0].vocabulary = NEW
        heard.until(lambda m: isinstance(m, JudgementMessage) and m.votes["cam1"].state == "foreign")
        assert heard.verdicts[-1].vocabulary.hash == OLD.digest
        cameras[1].vocabulary = cameras[2].vocabulary = NEW
        changed = cameras[2].seq
        heard.until(is_judged_in(NEW, "clap"))
        # By their posteriors, which a busy machine delays as it delays what is shown here.
        assert cameras[2].seq - changed < 1.0 * RATE_HZ
        until(lambda: listener.state.labels == NEW.labels)
        heard.until(lambda m: isinstance(m, VerdictMessage) and m.label == "clap")
    for message in heard.messages:
        if isinstance(message, JudgementMessage):
            check_vocabulary(message, KNOWN[message.vocabulary.hash])
    bow, end, clap = heard.verdicts[0], *heard.verdicts[-2:]
    assert (end.id, end.stage, clap.stage) == (bow.id, "ended", "decided") and clap.id != bow.id
    assert any(isinstance(message, VocabularyMessage) and message.hash == NEW.digest for message in heard.messages)
    asked = mesh.peer().ask_each(scene.keys.vocabulary, 1.0)
    assert {decode(VocabularyMessage, payload).hash for _, payload in asked} == {NEW.digest}
    # The standby service has followed: it goes on with the same movement.
    owner.set()
    went_on = heard.until(lambda m: isinstance(m, JudgementMessage) and m.fusion == "b" and m.label)
    assert went_on.vocabulary.hash == NEW.digest and went_on.movement.id == clap.id


@pytest.mark.parametrize("scene", ['vocabulary = ["bowing", "lunging"]\n'], indirect=True)
def test_a_scene_that_names_its_vocabulary_keeps_it(mesh, scene):
    heard, cameras = Heard(mesh, scene), [MovingObserver(mesh, scene, name) for name in CAMERAS]
    mesh.run(partial(serve, [scene], "a", mesh.peer("standby")))
    heard.until(is_judged_in(OLD, "bowing"))
    for camera in cameras:
        camera.vocabulary = NEW
    foreign = heard.until(lambda m: isinstance(m, JudgementMessage) and m.votes["cam3"].state == "foreign")
    assert foreign.vocabulary.hash == OLD.digest


def times(**fields):
    return {"bowing": MovementTimes(**fields)}


@pytest.mark.parametrize("scene", ["", 'vocabulary = ["bowing", "lunging"]\n'], ids=["any", "named"], indirect=True)
def test_the_durations_of_movements_are_those_that_the_observers_agree_on(mesh, scene):
    heard = Heard(mesh, scene)
    cameras = [
        MovingObserver(mesh, scene, name, replace(OLD, movements=times(rest_s=rest_s, period_s=period_s)))
        for name, rest_s, period_s in zip(CAMERAS, (0.3, 7.0, 0.5), (0.4, None, 0.6), strict=True)
    ]
    for camera in cameras:
        camera.rest = 0.95
    mesh.run(partial(serve, [scene], "a", mesh.peer("standby")))
    agreed = heard.until(lambda m: isinstance(m, VocabularyMessage) and m.movements == times(rest_s=0.5, period_s=0.5))
    assert (agreed.hash, agreed.fusion) == (OLD.digest, "a")
    hub = mesh.peer()

    def asked():
        """What all answer; none while one of them is late."""
        answers = [decode(VocabularyMessage, payload) for _, payload in hub.ask_each(scene.keys.vocabulary, 1.0)]
        return answers if len(answers) > len(CAMERAS) else None

    answers = until(asked)
    assert sorted(message.fusion or "" for message in answers) == ["", "", "", "a"]
    assert next(message for message in answers if message.fusion == "a").movements == agreed.movements
