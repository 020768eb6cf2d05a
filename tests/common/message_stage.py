"""Complete messages for the tests of common; a test names only the fields that it is about."""

import pytest
from hypothesis import strategies as st

from common.messages import (
    Agreement,
    JudgementMessage,
    PosteriorMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyHash,
    VocabularyReference,
    Vote,
)
from common.vocabulary import Vocabulary
from common.wire import BadMessage, decode

NAMES = Vocabulary(("bow", "lunge"), "karate")
REFERENCE = VocabularyReference(name=NAMES.name, hash=NAMES.digest)
FIELDS = {
    "v": 1, "scene": "dojo", "observer": "cam1", "seq": 0, "session": "s", "captured_ns": 1, "sent_ns": 2,
    "vocabulary": {"name": "m", "hash": "h"}, "p": [0.25, 0.75], "frames": 3,
}  # fmt: skip
"""The fields that a posterior must have."""
DISTRIBUTIONS = st.lists(st.floats(0.01, 1), min_size=2, max_size=20).map(lambda mass: [m / sum(mass) for m in mass])


def posterior(**fields):
    fields = {**FIELDS, **fields}
    return PosteriorMessage(**{**fields, "vocabulary": VocabularyHash(**fields["vocabulary"])})


def vote(**fields):
    return Vote(**{"label": "bow", "entropy": 0.5, "weight": 1.0, "age_s": 0.1, "state": "counted", **fields})


def judgement(kind=JudgementMessage, **fields):
    least = {
        "scene": "dojo", "fusion": "main", "seq": 0, "at_ns": 5, "p": [0.5, 0.5], "label": "bow", "certainty_bits": 0.5,
        "vocabulary": REFERENCE, "rule": "log", "votes": {"cam1": vote()}, "agreement": Agreement(k=1, n=1),
    }  # fmt: skip
    return kind(**{**least, **fields})


def verdict(**fields):
    return judgement(VerdictMessage, **{"id": "dojo-1", "began_ns": 3, "decided_ns": 5, **fields})


def status(**fields):
    return StatusMessage(**{"scene": "dojo", "id": "cam1", "state": "running", **fields})


def reason_of(kind, payload):
    """Why `payload` is no message of this kind; the error is one short line."""
    with pytest.raises(BadMessage) as caught:
        decode(kind, payload)
    assert str(caught.value).isprintable() and len(caught.value.detail) <= 200
    return caught.value.reason
