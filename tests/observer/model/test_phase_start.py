"""The phase model's first frames: an observer may start, or start again, while the person moves."""

import numpy as np
import pytest
from performances import DOOR

from common.vocabulary import Vocabulary
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS
from studies.performer import perform, perform_continuously

MOVEMENTS = ("lunging", "byebye", "nthrow", "stretch")
SOON = 3
"""Frames, a fifth of a second."""


@pytest.fixture(scope="module")
def model():
    return learn_view(perform(("2", "3", "4"), MOVEMENTS, trials=2), DOOR, Vocabulary(MOVEMENTS), kind="phase")


@pytest.fixture(scope="module")
def stream():
    return perform_continuously("1", MOVEMENTS, rest_s=(2.0, 2.6))


def started(model, stream, at):
    """Rest and posterior SOON frames after a start with frame `at`."""
    watch = model.watch(Onset())
    tracks = list(view_tracks(DOOR, stream, BODY_PARTS, BODY_PARTS))
    for each in tracks[at : at + SOON]:
        watch.update(each)
    return watch.rest, watch.p


def test_an_observer_that_starts_in_the_middle_of_a_movement_soon_sees_it(model, stream):
    starts = [(at, n) for n, span in enumerate(stream.spans) for at in range(span.start + 5, span.end - 8, 4)]
    outputs = [(*started(model, stream, at), n) for at, n in starts]
    assert np.mean([rest >= 0.5 for rest, _, _ in outputs]) <= 0.05
    assert np.mean([p.max() > 0.6 and p.argmax() != n for _, p, n in outputs]) <= 0.05


def test_an_observer_that_starts_while_the_person_rests_says_so(model, stream):
    ends, begins = [0, *(span.end for span in stream.spans)], [*(span.start for span in stream.spans), None]
    starts = [at for end, begin in zip(ends, begins, strict=True) for at in range(end + 6, (begin or end + 20) - 6, 4)]
    outputs = [started(model, stream, at) for at in starts]
    assert all(rest > 0.5 for rest, _ in outputs)
    assert np.mean([p.max() > 0.6 for _, p in outputs]) <= 0.05
