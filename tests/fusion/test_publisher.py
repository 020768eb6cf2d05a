"""What a service that is killed between two puts has told the world, and its own file."""

import math
from types import SimpleNamespace

import pytest
from engine_stage import LABELS, UNIFORM, VIEWS, EngineDriver, sure

from common.keys import SceneKeys
from common.messages import OngoingMovement, VerdictMessage
from common.wire import decode, encode
from fusion.publisher import REPEATS_LIMIT, VERDICTS_LIMIT, JudgementBatch, VerdictPublisher

VOCABULARY = b"the vocabulary as a message"


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
def test_a_first_word_is_in_the_file_before_it_is_sent_and_an_end_is_sent_before(played, sent, order):
    """Killed in between, a service ends after its restart what it has decided, and forgets no end that it has sent."""
    (scene, judgement), events = played, []
    keys = SceneKeys("dojo")

    def publisher(key, **_):
        def put(payload):
            kind = key.rpartition("/")[2]
            if kind not in ("votes", "vocabulary"):
                events.append(kind if kind == "judgement" else decode(VerdictMessage, payload).stage)

        return SimpleNamespace(put=put, has_subscriber=False)

    session = SimpleNamespace(publisher=publisher)
    file = SimpleNamespace(is_due=lambda judgement: True, write=lambda checkpoint: events.append("file"))
    VerdictPublisher(session, keys, scene.engine, file).publish(
        [scene.verdicts[n] for n in sent], judgement, VOCABULARY, 0.0
    )
    assert events == order


def test_the_last_verdicts_are_kept_for_late_joiners(played):
    scene, judgement = played
    publisher = SimpleNamespace(put=lambda _: None, has_subscriber=False)
    session = SimpleNamespace(publisher=lambda key, **_: publisher)
    owner = VerdictPublisher(session, SceneKeys("dojo"), scene.engine, None)
    assert owner.verdict_payloads == () and owner.judgement_payload is None
    for _ in range(VERDICTS_LIMIT):
        owner.publish(scene.verdicts[:2], judgement, VOCABULARY, 0.0)
    assert len(owner.verdict_payloads) == VERDICTS_LIMIT and owner.judgement_payload == encode(judgement)
    assert decode(VerdictMessage, owner.verdict_payloads[-1]).stage == "ended"


def test_judgements_of_many_scenes_are_sent_together_and_verdicts_at_once(played):
    (scene, judgement), events, outbox = played, [], JudgementBatch()

    def publisher(key, **_):
        scene_name, kind = key.split("/")[1:]
        return SimpleNamespace(
            put=lambda _: events.append((scene_name, kind)) if kind != "votes" else None, has_subscriber=False
        )

    session = SimpleNamespace(publisher=publisher)
    for name in ("north", "south"):
        one = VerdictPublisher(session, SceneKeys(name), scene.engine, None, put=outbox.put)
        one.publish(scene.verdicts[:1], judgement, VOCABULARY, 0.0)
    kinds = ("vocabulary", "verdict")
    assert events == [(name, kind) for name in ("north", "south") for kind in kinds]
    outbox.flush()
    outbox.flush()
    assert events[4:] == [("north", "judgement"), ("south", "judgement")]


def test_the_vocabulary_is_sent_once_an_epoch(played):
    (scene, judgement), sent = played, []
    session = SimpleNamespace(
        publisher=lambda key, **_: SimpleNamespace(
            put=lambda payload: sent.append(payload) if key.endswith("/vocabulary") else None, has_subscriber=False
        ),
    )
    owner = VerdictPublisher(session, SceneKeys("dojo"), scene.engine, None)
    for epoch in (1, 1, 2):
        owner.publish([], judgement.model_copy(update={"epoch": epoch}), VOCABULARY, 0.0)
    assert sent == [VOCABULARY, VOCABULARY]


@pytest.mark.parametrize(("since_s", "again"), [(0.0, [1, 2]), (2.0, [2]), (math.inf, [])])
def test_what_may_be_lost_is_sent_again_of_each_movement_the_last_verdict(played, since_s, again):
    """A listener would take a decision that follows its movement's end for a new one."""
    (scene, judgement), sent = played, []
    publisher = SimpleNamespace(put=sent.append, has_subscriber=False)
    session = SimpleNamespace(publisher=lambda key, **_: publisher)
    owner = VerdictPublisher(session, SceneKeys("dojo"), scene.engine, None, put=lambda *_: None)
    for at_s, verdict in enumerate(scene.verdicts[:3]):
        owner.publish([verdict], judgement, VOCABULARY, float(at_s))
    expected = [encode(scene.verdicts[n]) for n in again]
    for repeat in range(REPEATS_LIMIT + 1):
        sent.clear()
        owner.repeat_verdicts(since_s if repeat == 0 else 1.5 + repeat, 3.0 + repeat)
        assert sent == (expected if repeat < REPEATS_LIMIT else []), "what was sent again may be lost again"


def test_a_verdict_that_the_owner_sends_again_is_known_and_the_next_one_is_not(played):
    scene, _ = played
    publisher = SimpleNamespace(put=lambda _: None, has_subscriber=False)
    session = SimpleNamespace(publisher=lambda key, **_: publisher)
    standby = VerdictPublisher(session, SceneKeys("dojo"), scene.engine, None)
    standby.remember(scene.verdicts[0])
    assert [standby.has_published(verdict) for verdict in scene.verdicts[:3]] == [True, False, False]


def test_what_another_service_goes_on_with_is_not_sent_again(played):
    """It repeats what may be lost itself, and may have ended the movement where this service did not hear it."""
    (scene, judgement), sent = played, []
    publisher = SimpleNamespace(put=sent.append, has_subscriber=False)
    session = SimpleNamespace(publisher=lambda key, **_: publisher)
    owner = VerdictPublisher(session, SceneKeys("dojo"), scene.engine, None, put=lambda *_: None)
    decided, other = scene.verdicts[0], scene.verdicts[2]
    for verdict in (decided, other):
        owner.publish([verdict], judgement, VOCABULARY, 0.0)
    movement = OngoingMovement(id=decided.id, began_ns=decided.began_ns, label=decided.label)
    owner.remember(judgement.model_copy(update={"movement": movement, "fusion": "other"}))
    sent.clear()
    owner.repeat_verdicts(-1.0, 1.0)
    assert sent == [encode(other)]
