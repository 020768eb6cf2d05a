"""What a model was learned from comes back from its file, and forgotten movements leave it."""

from dataclasses import replace

import numpy as np
import pytest
from performances import DOOR

from common.vocabulary import Vocabulary
from observer.learning.editing import remove_movements
from observer.learning.learn import learn_view
from observer.model.base import Example, Stream, StreamSpan
from observer.model.training_memory import TrainingMemory
from observer.motion.archive import MotionArchive
from studies.performer import perform, perform_continuously

COLUMNS = 9


def trace(frames, first=0):
    return np.arange(first, first + frames)[:, None] * np.ones((1, COLUMNS), np.float32)


@pytest.fixture
def memory():
    examples = [Example((), m, k, person, "7") for m, k, person in ((0, 0, "anna"), (2, 1, "b"), (-1, 0, ""))]
    spans = (StreamSpan(2, 5, 0, "1"), StreamSpan(5, 7, 1, "2"), StreamSpan(8, 9, -1, "3"))
    streams = [Stream((), spans, 0, "anna", "9"), Stream((), (), 1, "b", "4")]
    examples = [replace(e, features=trace(n)) for e, n in zip(examples, (4, 1, 3), strict=True)]
    return TrainingMemory(
        tuple(examples), tuple(replace(s, features=trace(n)) for s, n in zip(streams, (10, 2), strict=True))
    )


def same(one, other):
    return all(
        (a.spans if isinstance(a, Stream) else a.movement, a.facing, a.subject, a.trial)
        == (b.spans if isinstance(b, Stream) else b.movement, b.facing, b.subject, b.trial)
        and np.array_equal(a.features, b.features)
        for a, b in zip((*one.examples, *one.streams), (*other.examples, *other.streams), strict=True)
    )


def test_a_file_gives_back_examples_and_streams(memory):
    assert same(memory, TrainingMemory.from_arrays(memory.as_arrays(), 3, 1, COLUMNS))
    empty = TrainingMemory((), ())
    assert same(empty, TrainingMemory.from_arrays(empty.as_arrays(), 3, 1, COLUMNS))


def test_a_forgotten_movement_leaves_examples_and_streams(memory):
    left = memory.renumbered({0: 1, -1: -1})
    assert [(e.movement, len(e.features)) for e in left.examples] == [(1, 4), (-1, 3)]
    first, second, other = left.streams
    assert first.features[:, 0].tolist() == [0, 1, 2, 3, 4] and second.features[:, 0].tolist() == [7, 8, 9]
    assert first.spans == (StreamSpan(2, 5, 1, "1"),) and second.spans == (StreamSpan(1, 2, -1, "3"),)
    assert len(other.features) == 2


DAMAGE = {
    "a movement that is unknown": {"example_movements": lambda a: a + 1},
    "a span beyond its stream": {"spans": lambda a: a * 3},
    "lengths that do not fit": {"stream_lengths": lambda a: a + 1},
    "traces of other parts": {"example_traces": lambda a: a[:, 1:]},
    "NaN": {"stream_traces": lambda a: a * np.nan},
    "fewer subjects": {"example_subjects": lambda a: a[1:]},
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_damage_is_an_error(memory, damage):
    arrays = memory.as_arrays()
    with pytest.raises((ValueError, IndexError)):
        TrainingMemory.from_arrays({**arrays, **{n: change(arrays[n]) for n, change in damage.items()}}, 3, 1, COLUMNS)


@pytest.fixture(scope="module")
def people():
    return perform(("1", "2"), ("ok", "shake", "lunging"), trials=2, seed=2)


def equal(one, other):
    assert one.header.background == other.header.background
    return all(np.array_equal(values, other.arrays()[name]) for name, values in one.arrays().items())


def test_forgetting_equals_not_having_learned_also_with_streams(people):
    continuous = perform_continuously("1", ("ok", "shake", "lunging"), seed=3)
    both = MotionArchive(people.body_parts, (*people.recordings, continuous))
    learned = learn_view(both, DOOR, Vocabulary(("ok", "lunging", "shake")), calibrate=False)
    smaller = remove_movements(learned, ("lunging",))
    wanted = learn_view(both, DOOR, Vocabulary(("ok", "shake")), calibrate=False)
    assert smaller.arrays()["stream_lengths"].tolist() == wanted.arrays()["stream_lengths"].tolist()
    assert smaller.header.vocabulary == wanted.header.vocabulary and not equal(learned, smaller)
