"""What is published of a step: the verdicts, full votes while somebody wants them, and a judgement that is small."""

from types import SimpleNamespace

import pytest

from benchmarks.posteriors import engine_of, message, random_posteriors, scene_of
from common.messages import JudgementMessage
from common.wire import decode, encode
from fusion.publisher import FULL_VOTES_AT_START, VerdictPublisher

START_NS = 1_700_000_000_000_000_000
MOST_BYTES = 900


class Session:
    """What was put, in order; `subscribed`: the keys under which somebody listens."""

    def __init__(self):
        self.put, self.subscribed = [], set()

    def publisher(self, key, **_):
        name = key.rsplit("/", 1)[-1]

        class Publisher:
            has_subscriber = property(lambda _: name in self.subscribed)
            put = staticmethod(lambda payload: self.put.append((name, payload)))

        return Publisher()

    def answer(self, key, last):
        pass


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


def published(judgements, session, **settings):
    publisher = VerdictPublisher(session, scene_of(4).keys, SimpleNamespace(), None, **settings)
    for judgement in judgements:
        publisher.publish([], judgement, b"", 0.0)
    return session.put


def test_a_judgement_has_less_than_900_bytes_and_shows_what_each_observer_believes(judgements):
    payloads = [payload for name, payload in published(judgements, Session()) if name == "judgement"]
    assert sorted(map(len, payloads))[len(payloads) // 2] <= MOST_BYTES and len(payloads[0]) <= MOST_BYTES
    for payload, judgement in zip(payloads, judgements, strict=True):
        received = decode(JudgementMessage, payload)
        assert received.label == judgement.label and received.p == pytest.approx(judgement.p, abs=1e-7)
        for name, vote in judgement.votes.items():
            assert received.votes[name].p == pytest.approx(vote.p, abs=0.004)
            assert (received.votes[name].label, received.votes[name].state) == (vote.label, vote.state)


def test_full_votes_come_first_at_the_start_and_then_only_while_somebody_wants_them(judgements):
    session = Session()
    names = [name for name, _ in published(judgements, session)]
    assert names == ["votes", "judgement"] * FULL_VOTES_AT_START + ["judgement"] * 3
    session.put.clear()
    session.subscribed.add("votes")
    pairs = published(judgements, session)
    assert [name for name, _ in pairs] == ["votes", "judgement"] * len(judgements)
    for (_, payload), judgement in zip(pairs[::2], judgements, strict=True):
        exact = {name: vote.model_copy(update={"root_p": None}) for name, vote in judgement.votes.items()}
        assert decode(JudgementMessage, payload) == judgement.model_copy(update={"votes": exact})


def test_full_votes_may_be_in_every_judgement(judgements):
    payloads = [payload for name, payload in published(judgements, Session(), full_votes=True) if name == "judgement"]
    assert payloads == [encode(judgement, full=True) for judgement in judgements]
