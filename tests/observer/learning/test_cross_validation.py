"""Cross-validation: which examples are left out, and which model evaluates them."""

import json
from collections import Counter

import numpy as np
import pytest

from common.vocabulary import Vocabulary
from observer.learning.learn import (
    FEWEST_FOLDS,
    MOST_EVALUATED,
    MOST_WATCHED,
    fewer_folds,
    folds_by_recording,
    with_calibration,
)
from observer.model.base import Example, Header
from observer.model.parameters import FACINGS

LABELS = ("bow", "lunge")
EVALUATIONS: list[tuple[frozenset[tuple[str, str, int]], tuple[str, str, int]]] = []
"""What was learned and what was evaluated: (subject, trial, movement)."""
HEADERS: list[Header] = []


class Spy:
    """A model whose tracks name their example."""

    kind = "spy"
    PARAMETERS = {"facings": FACINGS}  # noqa: RUF012 - as a model has it

    def __init__(self, header, learned):
        self.header, self.learned = header, learned

    @classmethod
    def learn(cls, header, examples):
        HEADERS.append(header)
        return cls(header, frozenset((e.subject, e.trial, e.movement) for e in examples))

    @classmethod
    def from_arrays(cls, header, arrays):
        return cls(header, arrays)

    def arrays(self):
        return self.learned

    def watch(self, onset):
        assert onset.known and onset.length
        return SpyWatch(self)


class BatchSpy(Spy):
    """A model that evaluates all examples of a fold at once; it takes note of the folds and of its facings."""

    SEEN: list[tuple[float, list[list[int]], set[int]]] = []  # noqa: RUF012 - for the test to read

    @classmethod
    def learn_with_streams(cls, header, examples, streams):
        return cls.learn(header, examples)

    def cross_validated(self, folds, watched):
        self.SEEN.append((self.header.parameters["facings"], folds, watched))
        return self


class SpyWatch:
    rest, joint, unlearned = 0.0, None, None
    p = np.full(2, 0.5)

    def __init__(self, model):
        self._learned = model.learned

    def update(self, tracks):
        EVALUATIONS.append((self._learned, tracks))


@pytest.fixture(autouse=True)
def clear():
    EVALUATIONS.clear()
    HEADERS.clear()
    BatchSpy.SEEN.clear()


def evaluate(header, examples):
    with_calibration(Spy(header, None), examples)


def header(facings=1.0):
    return Header("spy", Vocabulary(LABELS), "door", np.eye(3, 4), 15.0, ("head",), {"facings": facings})


def example(subject, trial, movement, facing=0):
    return Example([(subject, trial, movement)], movement, facing, subject, trial)


def examples(subjects, trials=("1", "2"), facings=1):
    return [example(s, t, m, k) for k in range(facings) for s in subjects for t in trials for m in range(len(LABELS))]


def test_each_person_is_evaluated_by_a_model_of_the_others():
    shown = examples("abcd")
    evaluate(header(), shown)
    assert Counter(evaluated for _, evaluated in EVALUATIONS) == Counter(
        (e.subject, e.trial, e.movement) for e in shown
    )
    for learned, (subject, _, _) in EVALUATIONS:
        assert {s for s, _, _ in learned} == set("abcd") - {subject}


@pytest.mark.parametrize(
    ("recordings", "never_left_out"),
    [
        pytest.param([(s, m) for s in "aaa" for m in (0, 1)], [], id="one person"),
        pytest.param([*[("a", 0)] * 2, *[(s, 1) for s in "aaabbb"]], [], id="one person for a movement"),
        pytest.param([("a", 0), *[("a", 1)] * 3], [0], id="one recording of a movement"),
    ],
)
def test_with_one_person_for_a_movement_recordings_are_left_out_in_turn(recordings, never_left_out):
    shown = [example(subject, str(n), movement) for n, (subject, movement) in enumerate(recordings)]
    evaluate(header(), shown)
    left_out = [(e.subject, e.trial, e.movement) for e in shown if e.movement not in never_left_out]
    assert sorted(evaluated for _, evaluated in EVALUATIONS) == sorted(left_out)
    for learned, evaluated in EVALUATIONS:
        assert evaluated not in learned and {movement for _, _, movement in learned} == {0, 1}


def test_of_many_examples_only_a_share_is_evaluated():
    shown = examples([str(n) for n in range(10)], trials=[str(n) for n in range(30)])
    evaluate(header(), shown)
    assert MOST_EVALUATED / 2 <= len(EVALUATIONS) <= MOST_EVALUATED * 1.5
    assert {movement for _, (_, _, movement) in EVALUATIONS} == {0, 1}
    assert all(subject not in {s for s, _, _ in learned} for learned, (subject, _, _) in EVALUATIONS)


def test_only_one_facing_is_evaluated():
    evaluate(header(4.0), examples("abc", facings=4))
    assert len(EVALUATIONS) == 12 and all(h.parameters["facings"] == 1.0 for h in HEADERS)


@pytest.mark.parametrize(
    ("subjects", "trials", "left_out"),
    [
        pytest.param("abcdef", "1234567", [{"a", "d"}, {"b", "e"}, {"c", "f"}], id="people"),
        pytest.param("abcdef", "1", [{s} for s in "abcdef"], id="people with few examples"),
        pytest.param("a", "12", [{("a", "1")}, {("a", "2")}], id="one person: recordings"),
    ],
)
@pytest.mark.parametrize("facings", [1, 4, 12])
def test_a_fold_at_once_is_evaluated_at_all_facings_by_models_that_know_it_at_none(subjects, trials, left_out, facings):
    shown = examples(subjects, trials, facings)
    with_calibration(BatchSpy(header(float(facings)), None), shown)
    ((known, seen, watched),) = BatchSpy.SEEN
    assert known == facings
    by_person = len(subjects) > 1
    folds = [{e.subject if by_person else (e.subject, e.trial) for e in map(shown.__getitem__, f)} for f in seen]
    assert folds == left_out
    assert sorted(n for fold in seen for n in fold) == list(range(len(shown)))
    watched = [shown[n] for n in watched]
    assert {e.facing for e in watched} == set(range(facings)) and {e.movement for e in watched} == {0, 1}


def test_the_folds_become_fewer_with_the_number_of_takes_one_by_one():
    takes = {n: examples("a", [str(k) for k in range(n)]) for n in range(3, 90)}
    counts = [len(fewer_folds(shown, folds_by_recording(shown))) for shown in takes.values()]
    most = counts.index(max(counts))
    assert counts[: most + 1] == [*takes][: most + 1] and counts[most:] == sorted(counts[most:], reverse=True)
    assert counts[-1] == FEWEST_FOLDS and min(np.diff(counts[most:])) >= -2


def test_of_many_examples_at_many_facings_a_share_is_watched_evenly():
    shown = examples("abcdefghij", trials=[str(n) for n in range(10)], facings=12)
    with_calibration(BatchSpy(header(12.0), None), shown)
    watched = [shown[n] for n in BatchSpy.SEEN[0][2]]
    assert 0.9 * MOST_WATCHED <= len(watched) <= 1.1 * MOST_WATCHED
    of_facings = Counter(e.facing for e in watched)
    assert len(of_facings) == 12 and max(of_facings.values()) <= 2 * min(of_facings.values())


def test_the_evaluation_leaves_the_model_unchanged():
    shown = examples("abcde", facings=4)
    model = Spy.learn(header(4.0), shown)
    evaluated = with_calibration(model, shown)
    assert evaluated.learned == model.learned and evaluated.header.parameters == {"facings": 4.0}
    # The spy's posterior is uniform, and argmax takes the first.
    provenance = dict(evaluated.header.provenance)
    assert json.loads(provenance.pop("held_out")) == {"bow": {"bow": 10}, "lunge": {"bow": 10}}
    assert provenance == {"tried": "20", "right": "10"}
