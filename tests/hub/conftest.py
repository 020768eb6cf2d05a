"""Messages of a small scene, as a fusion service would say them."""

import math
from types import SimpleNamespace

import pytest

from common.messages import (
    Agreement,
    JudgementMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
    VocabularyReference,
    Vote,
)
from common.vocabulary import Vocabulary

SECOND = 1_000_000_000
NOON = 1_700_000_000 * SECOND
VOCABULARY = Vocabulary(("byebye", "maestro", "ok", "nthrow"))
REFERENCE = VocabularyReference(name="movements", hash=VOCABULARY.digest)


def vote(label="nthrow", p=(0.1, 0.1, 0.1, 0.7), weight=0.5, state="counted", age_s=0.05):
    entropy = -sum(x * math.log2(x) for x in p if x > 0) if all(map(math.isfinite, p)) else None
    return Vote(label=label, entropy=entropy, weight=weight, age_s=age_s, state=state, p=list(p))


def judgement(seq=1, at_ns=NOON, label="nthrow", p=(0.1, 0.1, 0.2, 0.6), votes=None, fusion="fuse1", **more):
    votes = {"cam1": vote("ok", (0.1, 0.1, 0.5, 0.3)), "cam2": vote()} if votes is None else votes
    k = sum(each.label == label for each in votes.values())
    return (VerdictMessage if more else JudgementMessage)(
        scene="room", fusion=fusion, seq=seq, at_ns=at_ns, vocabulary=REFERENCE, p=list(p), label=label,
        certainty_bits=1.57, rule="inverse_entropy", votes=votes, agreement=Agreement(k=k, n=len(votes)), **more,
    )  # fmt: skip


def verdict(number=1, ended_ns=None, at_ns=NOON, began_ns=NOON - SECOND, **more):
    return judgement(at_ns=at_ns, id=f"v{number}", began_ns=began_ns, decided_ns=NOON, ended_ns=ended_ns, **more)


def vocabulary():
    return VocabularyMessage(scene="room", name="movements", hash=VOCABULARY.digest, labels=list(VOCABULARY.labels))


def status(who="cam1", state="running", reason="", rate_hz=30.0):
    return StatusMessage(scene="room", id=who, state=state, reason=reason, rate_hz=rate_hz)


@pytest.fixture(scope="session")
def said():
    """Makers of messages: vote, judgement, verdict, vocabulary, status; and the times NOON and SECOND in ns."""
    return SimpleNamespace(
        vote=vote, judgement=judgement, verdict=verdict, vocabulary=vocabulary, status=status, NOON=NOON, SECOND=SECOND
    )
