"""A model of few takes knows what people do beside them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view, this_camera
from observer.model import common_gestures_table
from observer.model.base import Example, Header
from observer.model.common_gestures import COMMON_GESTURES, cosines, drawn_traces, streams_for
from observer.model.discriminative import Discriminative
from observer.tracks import BODY_PARTS

PARTS = ("head", "left_hand", "right_hand")


def header(**changes):
    view = this_camera("sofa")
    own = Header("stacked", Vocabulary(("push", "lift")), view.name, view.matrix, 15.0, PARTS, {COMMON_GESTURES: 1.0})
    return replace(own, **changes)


def takes(*gestures):
    """Two takes of each, which hardly differ."""
    traces = [trace + np.float32(0.02 * k) * (np.arange(9) < 6) for trace in gestures for k in range(2)]
    examples = [
        Example((), n // 2, subject="ab"[n % 2], trial=str(n), features=trace.astype(float))
        for n, trace in enumerate(traces)
    ]
    return examples, traces


@pytest.fixture(scope="module")
def far():
    """Takes of two movements that nobody makes: both hands far below and beside the feet."""
    way = np.linspace(0, 1, 20)[:, None]
    return takes(*(np.hstack([way * row, np.ones((20, 1))]).astype(np.float32) for row in 40 * np.eye(8)[2:4]))


def test_the_cosines_are_the_basis_of_the_discrete_cosine_transform():
    basis = cosines(30)
    np.testing.assert_allclose(basis.T @ basis, np.diag([30.0, *[15.0] * (basis.shape[1] - 1)]), atol=1e-9)
    assert (np.diff(basis[:, 1]) < 0).all(), "the first one goes from 1 to -1"


def test_the_gestures_are_always_the_same_at_any_rate_and_in_any_order_of_parts():
    slow, fast = drawn_traces(15.0, PARTS), drawn_traces(30.0, BODY_PARTS)
    assert len(slow) == len(fast) > 100
    assert all(np.isfinite(trace).all() and np.ptp(trace) < 15 for trace in slow)
    for one, other in zip(slow, fast, strict=True):
        assert abs(2 * len(one) - len(other)) <= 1 + len(one) / 2
    left = [trace[:, 2 * parts.index("left_hand")].mean() for trace, parts in ((slow[0], PARTS), (fast[0], BODY_PARTS))]
    assert left[0] == pytest.approx(left[1], abs=0.05)


def test_a_model_of_few_takes_learns_them_and_no_other_model(far):
    examples, traces = far
    assert len(streams_for(header(), examples, traces)) == len(drawn_traces(15.0, PARTS))
    door = parse_view("door")
    many = Vocabulary(tuple(f"m{n}" for n in range(9)))
    for other in (
        header(parameters={COMMON_GESTURES: 0.0}),
        header(view=door.name, matrix=door.matrix),
        header(body_parts=("head", "left_hand", "left_foot")),
        header(vocabulary=many),
    ):
        assert not streams_for(other, examples, traces)
    assert not streams_for(header(), examples * 20, traces * 20)
    one_person = [replace(example, subject="a") for example in examples]
    assert not streams_for(header(), one_person, traces)
    assert streams_for(header(parameters={COMMON_GESTURES: 2.0}), one_person, traces)


def test_a_gesture_like_a_taught_movement_is_not_something_else():
    first = drawn_traces(15.0, PARTS)
    examples, traces = takes(first[0], first[60])
    remaining = {stream.trial for stream in streams_for(header(), examples, traces)}
    assert {"0", "60"}.isdisjoint(remaining) and len(remaining) > len(first) / 2


def test_the_table_is_small():
    assert Path(common_gestures_table.__file__).stat().st_size < 20_000


def test_a_model_that_learned_them_takes_them_for_something_else_and_names_what_was_taught(far):
    gestures = drawn_traces(15.0, PARTS)
    examples, _ = takes(gestures[0], gestures[60])
    model = Discriminative.learn_with_streams(
        header(kind="discriminative", parameters={COMMON_GESTURES: 1.0, "kernels": 84.0}), examples, ()
    )
    assert not model.memory.streams, "they are no part of the file"
    features = [model.trailing.of(trace, np.array([len(trace) - 1])) for trace in gestures]
    log_p = np.concatenate([model.movement.log_probabilities(row) for row in features])
    assert log_p[0, :2].argmax() == 0 and log_p[60, :2].argmax() == 1
    other = np.exp(log_p[:, -1])
    assert max(other[0], other[60]) < 0.5 < np.median(other)
