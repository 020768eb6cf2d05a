"""What a service that is killed between two puts has told the world, and its own file."""

from types import SimpleNamespace

import pytest
from engine_stage import LABELS, UNIFORM, VIEWS, EngineDriver, sure

from common.keys import SceneKeys
from common.messages import VerdictMessage
from common.wire import decode
from fusion.publisher import VERDICTS_LIMIT, JudgementBatch, VerdictPublisher


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

    def publisher(key):
        def put(payload):
            kind = key.rpartition("/")[2]
            if kind != "votes":
                events.append(kind if kind == "judgement" else decode(VerdictMessage, payload).stage)

        return SimpleNamespace(put=put, has_subscriber=False)

    session = SimpleNamespace(publisher=publisher, answer=lambda *_: None)
    file = SimpleNamespace(is_due=lambda judgement: True, write=lambda checkpoint: events.append("file"))
    VerdictPublisher(session, keys, scene.engine, file).publish([scene.verdicts[n] for n in sent], judgement)
    assert events == order


def test_late_joiners_receive_the_last_verdicts_of_the_owner_alone(played):
    (scene, judgement), queries = played, {}
    publisher = SimpleNamespace(put=lambda _: None, has_subscriber=False)
    session = SimpleNamespace(publisher=lambda key: publisher, answer=queries.__setitem__)
    keys = SceneKeys("dojo")
    owner = VerdictPublisher(session, keys, scene.engine, None)
    for _ in range(VERDICTS_LIMIT):
        owner.publish(scene.verdicts[:2], judgement)
    assert queries[keys.verdict]() is None and queries[keys.judgement]() is None
    owner.answers = True
    assert len(queries[keys.verdict]()) == VERDICTS_LIMIT
    assert decode(VerdictMessage, queries[keys.verdict]()[-1]).stage == "ended"


def test_judgements_of_many_scenes_are_sent_together_and_verdicts_at_once(played):
    (scene, judgement), events, outbox = played, [], JudgementBatch()

    def publisher(key):
        scene_name, kind = key.split("/")[1:]
        return SimpleNamespace(
            put=lambda _: events.append((scene_name, kind)) if kind != "votes" else None, has_subscriber=False
        )

    session = SimpleNamespace(publisher=publisher, answer=lambda *_: None)
    for name in ("north", "south"):
        one = VerdictPublisher(session, SceneKeys(name), scene.engine, None, put=outbox.put)
        one.publish(scene.verdicts[:1], judgement)
    assert events == [("north", "verdict"), ("south", "verdict")]
    outbox.flush()
    outbox.flush()
    assert events[2:] == [("north", "judgement"), ("south", "judgement")]
