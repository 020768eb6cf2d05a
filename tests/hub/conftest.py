"""Messages of a small scene as a fusion service publishes them, and a link that the test fills."""

import math
from types import SimpleNamespace

import pytest
from played_scene import REFERENCE, VOCABULARY

from common import SECOND_NS
from common.config import MeshConfig, read_scene
from common.inbox import Inbox, Presence
from common.link import Link
from common.messages import (
    Agreement,
    JudgementMessage,
    OngoingMovement,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
    Vote,
)
from common.vocabulary import Vocabulary

NOON = 1_700_000_000 * SECOND_NS


def vote(label="nthrow", p=(0.1, 0.1, 0.1, 0.7), weight=0.5, state="counted", age_s=0.05, **more):
    entropy = -sum(x * math.log2(x) for x in p if x > 0)
    fields = {"rest": 0.1, **more}
    return Vote(label=label, entropy=entropy, weight=weight, age_s=age_s, state=state, p=list(p), **fields)


def judgement(seq=1, at_ns=NOON, label="nthrow", p=(0.1, 0.1, 0.2, 0.6), votes=None, **more):
    """A judgement; a verdict if it has an id. Its agreement is counted as fusion counts it."""
    votes = {"cam1": vote("ok", (0.1, 0.1, 0.5, 0.3)), "cam2": vote()} if votes is None else votes
    agrees = [each.label == label for each in votes.values() if each.state in ("counted", "stale")]
    facts = {"scene": "room", "fusion": "fuse1", "seq": seq, "at_ns": at_ns, "vocabulary": REFERENCE, "p": list(p),
             "label": label, "certainty_bits": 1.57, "rule": "inverse_entropy", "votes": votes,
             "agreement": Agreement(k=sum(agrees), n=len(agrees))}  # fmt: skip
    return (VerdictMessage if "id" in more else JudgementMessage)(**facts, **more)


def moving(seq=1, number=1, decided=None, at_ns=NOON, revises=None, **more):
    """A judgement during the movement `v<number>`, which is `decided` to be that label or undecided."""
    decision = {"label": decided, "decided_ns": decided and NOON, "revises": revises}
    movement = OngoingMovement(id=f"v{number}", began_ns=NOON, **decision)
    return judgement(seq, at_ns, movement=movement, **more)


def waiting(seq=1, at_ns=NOON, label="", **more):
    """A judgement to which no observer contributes."""
    silent = Vote(label=None, entropy=None, weight=0.0, age_s=None, state="silent")
    return judgement(seq, at_ns, label, (0.25,) * 4, {"cam1": silent, "cam2": silent}, **more)


def verdict(number=1, ended_ns=None, at_ns=NOON, began_ns=NOON - SECOND_NS, **more):
    return judgement(at_ns=at_ns, id=f"v{number}", began_ns=began_ns, decided_ns=NOON, ended_ns=ended_ns, **more)


def vocabulary(labels=VOCABULARY.labels):
    digest = Vocabulary(tuple(labels)).digest
    return VocabularyMessage(scene="room", name="movements", hash=digest, labels=list(labels))


def status(process="cam1", state="running", reason="", rate_hz=30.0, **more):
    return StatusMessage(scene="room", id=process, state=state, reason=reason, rate_hz=rate_hz, **more)


@pytest.fixture(scope="session")
def make():
    """Makers of messages, and the times NOON and SECOND in ns."""
    makers = (vote, judgement, moving, waiting, verdict, vocabulary, status)
    return SimpleNamespace(**{maker.__name__: maker for maker in makers}, NOON=NOON, SECOND=SECOND_NS)


@pytest.fixture
def scene_file(tmp_path):
    """Writes a scene file with two observers that meet at `endpoint`; text: more sections."""

    def write(endpoint="tcp/127.0.0.1:7447", text=""):
        observers = "".join(f'[observers.{name}]\nsource = "a.npz"\n' for name in ("cam1", "cam2"))
        file = tmp_path / "scene.toml"
        file.write_text(f'scene = "room"\n[mesh]\nendpoint = "{endpoint}"\n{text}{observers}')
        return file

    return write


@pytest.fixture
def scene(scene_file):
    """A scene with two observers."""
    return read_scene(scene_file(), {})


@pytest.fixture
def fusion():
    """The link of a fusion service, where all processes meet."""
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as link:
        yield link


class FakeLink:
    """A link whose inboxes the test fills by `put`. answers: (key, payload) pairs that answer queries. meanwhile: what
    arrives in the inboxes while a query waits."""

    def __init__(self, answers=(), meanwhile=()):
        self.answers, self.meanwhile = answers, list(meanwhile)
        self.boxes, self.queries, self.present = {}, [], Presence()

    def inbox(self, *keys, limit=4096):
        self.boxes |= dict.fromkeys(keys, Inbox(limit))
        return self.boxes[keys[0]]

    def put(self, key, payload):
        box = self.boxes.get(key) or self.boxes[key.replace("/cam1/", "/*/").replace("/cam2/", "/*/")]
        box.put(key, payload)

    def presence(self, key, expected=()):
        return self.present

    def request(self, key, answered, timeout_s):
        for pair in self.ask_each(key, timeout_s):
            answered(*pair)

    def ask_each(self, key, timeout_s):
        self.queries.append(key)
        for arrived in self.meanwhile:
            self.put(*arrived)
        self.meanwhile = []
        return [pair for pair in self.answers if key.endswith("**") or pair[0] == key]


@pytest.fixture(scope="session")
def fake_link():
    return FakeLink
