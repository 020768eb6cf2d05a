"""What is published of a step, in which order, and what a service that is killed between two puts has told the world. A
judgement is small, and full votes are published while somebody wants them."""

import math
from types import SimpleNamespace

import pytest
from engine_stage import LABELS, UNIFORM, VIEWS, EngineDriver, sure

from benchmarks.posteriors import engine_of, message, random_posteriors, scene_of
from common.keys import SceneKeys
from common.messages import JudgementMessage, OngoingMovement, VerdictMessage
from common.wire import decode, encode
from fusion.checkpoint import CheckpointFile
from fusion.publisher import FULL_VOTES_AT_START, REPEATS_LIMIT, VERDICTS_LIMIT, JudgementBatch, VerdictPublisher

VOCABULARY = b"the vocabulary as a message"
START_NS = 1_700_000_000_000_000_000
MOST_BYTES = 900


class Session:
    """What was put, in order: scene, kind and payload; `subscribed`: the kinds to which somebody listens."""

    def __init__(self):
        self.put, self.subscribed = [], set()

    def publisher(self, key, **_):
        scene, kind = key.split("/")[1:]

        class Publisher:
            has_subscriber = property(lambda _: kind in self.subscribed)
            put = staticmethod(lambda payload: self.put.append((scene, kind, payload)))

        return Publisher()

    def payloads(self, *kinds):
        """What was put of these kinds."""
        return [payload for _, kind, payload in self.put if kind in kinds]


@pytest.fixture
def session():
    return Session()


@pytest.fixture(scope="module")
def played():
    """An engine that has decided and ended two movements: its verdicts in order, and its last judgement."""
    scene = EngineDriver(quorum=2)
    for label in LABELS[:2]:
        scene.step(dict.fromkeys(VIEWS, UNIFORM), 0.95, 20)
        scene.step(dict.fromkeys(VIEWS, sure(label)), 0.05, 20)
        judgement = scene.step(dict.fromkeys(VIEWS, UNIFORM), 0.95, 20)
    return scene, judgement


@pytest.mark.parametrize(
    ("sent", "order"),
    [
        ([], ["judgement", "file"]),
        ([0], ["file", "decided", "judgement"]),
        ([1], ["ended", "judgement", "file"]),
        ([0, 1], ["decided", "ended", "judgement", "file"]),
        ([1, 2], ["ended", "file", "decided", "judgement"]),
    ],
)
def test_a_first_word_is_in_the_file_before_it_is_sent_and_an_end_is_sent_before(played, session, sent, order):
    """Killed in between, a service ends after its restart what it has decided, and forgets no end that it has sent."""
    scene, judgement = played
    file = SimpleNamespace(is_due=lambda *_: True, write=lambda _: session.put.append(("dojo", "file", b"")))
    owner = VerdictPublisher(session, SceneKeys("dojo"), scene.engine, file)
    owner.publish([scene.verdicts[n] for n in sent], judgement, VOCABULARY, 0.0)
    names = {encode(verdict): verdict.stage for verdict in scene.verdicts}
    events = [names.get(payload, kind) for _, kind, payload in session.put if kind not in ("votes", "vocabulary")]
    assert events == order


def test_the_last_verdicts_are_kept_for_late_joiners(played, session):
    scene, judgement = played
    owner = VerdictPublisher(session, SceneKeys("dojo"), scene.engine, None)
    assert owner.verdict_payloads == () and owner.judgement_payload is None
    for _ in range(VERDICTS_LIMIT):
        owner.publish(scene.verdicts[:2], judgement, VOCABULARY, 0.0)
    assert len(owner.verdict_payloads) == VERDICTS_LIMIT and owner.judgement_payload == encode(judgement)
    assert decode(VerdictMessage, owner.verdict_payloads[-1]).stage == "ended"


def test_judgements_of_many_scenes_are_sent_together_and_verdicts_at_once(played, session):
    (scene, judgement), outbox = played, JudgementBatch()
    for name in ("north", "south"):
        one = VerdictPublisher(session, SceneKeys(name), scene.engine, None, put=outbox.put)
        one.publish(scene.verdicts[:1], judgement, VOCABULARY, 0.0)
    at_once = len(session.put)
    outbox.flush()
    outbox.flush()
    events = [(name, kind) for name, kind, _ in session.put if kind != "votes"]
    assert events[:4] == [(name, kind) for name in ("north", "south") for kind in ("vocabulary", "verdict")]
    assert events[4:] == [("north", "judgement"), ("south", "judgement")]
    assert "judgement" not in {kind for _, kind, _ in session.put[:at_once]}


def test_the_vocabulary_is_sent_once_an_epoch(played, session):
    scene, judgement = played
    owner = VerdictPublisher(session, SceneKeys("dojo"), scene.engine, None)
    for epoch in (1, 1, 2):
        owner.publish([], judgement.model_copy(update={"epoch": epoch}), VOCABULARY, 0.0)
    assert session.payloads("vocabulary") == [VOCABULARY, VOCABULARY]


@pytest.mark.parametrize(("since_s", "again"), [(0.0, [1, 2]), (2.0, [2]), (math.inf, [])])
def test_what_may_be_lost_is_sent_again_of_each_movement_the_last_verdict(played, session, since_s, again):
    """A listener would take a decision that follows its movement's end for a new one."""
    scene, judgement = played
    owner = VerdictPublisher(session, SceneKeys("dojo"), scene.engine, None, put=lambda *_: None)
    for at_s, verdict in enumerate(scene.verdicts[:3]):
        owner.publish([verdict], judgement, VOCABULARY, float(at_s))
    expected = [encode(scene.verdicts[n]) for n in again]
    for repeat in range(REPEATS_LIMIT + 1):
        session.put.clear()
        owner.repeat_verdicts(since_s if repeat == 0 else 1.5 + repeat, 3.0 + repeat)
        assert session.payloads("verdict") == (expected if repeat < REPEATS_LIMIT else []), (
            "what was sent again may be lost again"
        )


def test_an_end_that_was_sent_as_the_link_broke_is_in_the_file_until_it_is_sent_again(played, session, tmp_path):
    """A listener has the decision; where the service is killed before the link is back, the next one sends the end."""
    scene, judgement = played
    path, judgement = tmp_path / "memory.json", judgement.model_copy(update={"scene": "dojo", "movement": None})
    owner = VerdictPublisher(session, SceneKeys("dojo"), scene.engine, CheckpointFile(path, "a", "memory"))

    def undelivered():
        return [(verdict.id, verdict.stage) for verdict in CheckpointFile(path).read("dojo").undelivered]

    owner.publish(scene.verdicts[:2], judgement, VOCABULARY, 1.0)
    owner.keep_undelivered(math.inf)
    assert undelivered() == []
    for doubtful_from_s, expected in ((1.5, []), (0.5, [(scene.verdicts[1].id, "ended")]), (math.inf, [])):
        owner.keep_undelivered(doubtful_from_s)
        assert undelivered() == expected
    owner.publish(scene.verdicts[2:3], judgement, VOCABULARY, 2.0)
    owner.keep_undelivered(0.5)
    assert undelivered() == [(scene.verdicts[1].id, "ended")], "a movement that goes on is in the file anyway"


def test_a_verdict_that_the_owner_sends_again_is_known_and_the_next_one_is_not(played, session):
    scene, _ = played
    standby = VerdictPublisher(session, SceneKeys("dojo"), scene.engine, None)
    standby.remember(scene.verdicts[0])
    assert [standby.has_published(verdict) for verdict in scene.verdicts[:3]] == [True, False, False]


def test_what_another_service_goes_on_with_is_not_sent_again(played, session):
    """It repeats what may be lost itself, and may have ended the movement where this service did not hear it."""
    scene, judgement = played
    owner = VerdictPublisher(session, SceneKeys("dojo"), scene.engine, None, put=lambda *_: None)
    decided, other = scene.verdicts[0], scene.verdicts[2]
    for verdict in (decided, other):
        owner.publish([verdict], judgement, VOCABULARY, 0.0)
    movement = OngoingMovement(id=decided.id, began_ns=decided.began_ns, label=decided.label)
    owner.remember(judgement.model_copy(update={"movement": movement, "fusion": "other"}))
    session.put.clear()
    owner.repeat_verdicts(-1.0, 1.0)
    assert session.payloads("verdict") == [encode(other)]


@pytest.fixture(scope="module")
def judgements():
    """Of four observers and twenty movements."""
    scene, p = scene_of(4), random_posteriors(4 * (FULL_VOTES_AT_START + 3))
    engine, result = engine_of(scene), []
    for seq in range(FULL_VOTES_AT_START + 3):
        at_ns = START_NS + seq * 16_666_667
        for n, name in enumerate(scene.roster):
            assert engine.receive(name, message(seq, at_ns, p[4 * seq + n], facets=0, unlearned=None), at_ns) is None
        result.append(engine.step(at_ns).judgement)
    return result


def publish(judgements, session, **settings):
    publisher = VerdictPublisher(session, scene_of(4).keys, SimpleNamespace(), None, **settings)
    for judgement in judgements:
        publisher.publish([], judgement, b"", 0.0)


def test_a_judgement_has_less_than_900_bytes_and_shows_what_each_observer_believes(judgements, session):
    publish(judgements, session)
    payloads = session.payloads("judgement")
    assert sorted(map(len, payloads))[len(payloads) // 2] <= MOST_BYTES and len(payloads[0]) <= MOST_BYTES
    for payload, judgement in zip(payloads, judgements, strict=True):
        received = decode(JudgementMessage, payload)
        assert received.label == judgement.label and received.p == pytest.approx(judgement.p, abs=1e-7)
        for name, vote in judgement.votes.items():
            assert received.votes[name].p == pytest.approx(vote.p, abs=0.004)
            assert (received.votes[name].label, received.votes[name].state) == (vote.label, vote.state)


def test_full_votes_come_first_at_the_start_and_then_only_while_somebody_wants_them(judgements, session):
    publish(judgements, session)
    kinds = [kind for _, kind, _ in session.put]
    assert kinds == ["votes", "judgement"] * FULL_VOTES_AT_START + ["judgement"] * 3
    session.put.clear()
    session.subscribed.add("votes")
    publish(judgements, session)
    assert [kind for _, kind, _ in session.put] == ["votes", "judgement"] * len(judgements)
    for payload, judgement in zip(session.payloads("votes"), judgements, strict=True):
        exact = {name: vote.model_copy(update={"root_p": None}) for name, vote in judgement.votes.items()}
        assert decode(JudgementMessage, payload) == judgement.model_copy(update={"votes": exact})


def test_a_revision_is_a_line_in_the_log(played, session, caplog):
    caplog.set_level("INFO", "labanmesh.fusion")
    (scene, judgement), (decided, *_) = played, played[0].verdicts
    revised = decided.model_copy(update={"stage": "revised", "revises": decided.label, "label": LABELS[1]})
    VerdictPublisher(session, SceneKeys("dojo"), scene.engine, None).publish([revised], judgement, VOCABULARY, 0.0)
    assert caplog.messages[-1].endswith(f": {LABELS[1]}, 4 of 4 agree, revised from {decided.label}")


def test_full_votes_may_be_in_every_judgement(judgements, session):
    publish(judgements, session, full_votes=True)
    assert session.payloads("judgement") == [encode(judgement, full=True) for judgement in judgements]
