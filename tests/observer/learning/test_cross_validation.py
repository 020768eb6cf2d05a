"""Cross-validation: which examples are left out, and which model evaluates them."""

from collections import Counter

import numpy as np
import pytest

from common.vocabulary import Vocabulary
from observer.learning.learn import MOST_EVALUATED, with_calibration
from observer.model.base import Example, Header
from observer.model.posterior_calibration import CAUTIOUS

LABELS = ("bow", "lunge")
EVALUATIONS: list[tuple[frozenset[tuple[str, str, int]], tuple[str, str, int]]] = []
"""What was learned and what was evaluated: (subject, trial, movement)."""
HEADERS: list[Header] = []


class Spy:
    """A model whose examples are shown_examples as tracks that name themselves."""

    kind = "spy"
    DEFAULTS = {"facings": 1.0}  # noqa: RUF012 - as a model has it

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


class SpyWatch:
    rest, joint, foreseen, unlearned = 0.0, None, None, None
    p = np.full(2, 0.5)

    def __init__(self, model):
        self._learned = model.learned

    def update(self, tracks):
        EVALUATIONS.append((self._learned, tracks))


@pytest.fixture(autouse=True)
def clear():
    EVALUATIONS.clear()
    HEADERS.clear()


def calibration_of(header, examples):
    return with_calibration(Spy, Spy(header, None), examples).header.calibration


def header(facings=1.0):
    return Header("spy", Vocabulary(LABELS), "door", np.eye(3, 4), 15.0, ("head",), {"facings": facings})


def example(subject, trial, movement, facing=0):
    return Example([(subject, trial, movement)], movement, facing, subject, trial)


def examples(subjects, trials=("1", "2"), facings=1):
    return [example(s, t, m, k) for k in range(facings) for s in subjects for t in trials for m in range(len(LABELS))]


def test_each_person_is_evaluated_by_a_model_of_the_others():
    shown_examples = examples("abcd")
    calibration_of(header(), shown_examples)
    assert Counter(evaluated for _, evaluated in EVALUATIONS) == Counter(
        (e.subject, e.trial, e.movement) for e in shown_examples
    )
    for learned, (subject, _, _) in EVALUATIONS:
        assert {s for s, _, _ in learned} == set("abcd") - {subject}


def test_with_one_person_recordings_are_left_out_in_turn():
    shown_examples = examples("a", trials=("1", "2", "3"))
    calibration_of(header(), shown_examples)
    assert len(EVALUATIONS) == len(shown_examples)
    for learned, evaluated in EVALUATIONS:
        assert evaluated not in learned and len(learned) == 4
        assert {m for _, _, m in learned} == {0, 1}


def test_with_one_person_for_a_movement_recordings_are_left_out_in_turn():
    shown_examples = [*examples("ab", trials=("1", "2")), example("a", "3", 1), example("b", "3", 1)]
    shown_examples = [e for e in shown_examples if e.movement == 1 or e.subject == "a"]
    assert {e.subject for e in shown_examples if e.movement == 0} == {"a"}
    calibration_of(header(), shown_examples)
    assert len(EVALUATIONS) == len(shown_examples)
    assert all(evaluated not in learned and {m for _, _, m in learned} == {0, 1} for learned, evaluated in EVALUATIONS)


def test_the_only_recording_of_a_movement_is_always_learned_and_never_evaluated():
    shown_examples = [example("a", "1", 0), *(example("a", str(t), 1) for t in range(3))]
    calibration_of(header(), shown_examples)
    assert [evaluated for _, evaluated in EVALUATIONS] == [("a", str(t), 1) for t in range(3)]
    assert all(("a", "1", 0) in learned and evaluated not in learned for learned, evaluated in EVALUATIONS)


@pytest.mark.parametrize(
    "shown_examples", [examples("a", trials=("1",)), examples("ab"), examples("a", trials=("1", "2"))]
)
def test_with_few_examples_the_calibration_is_cautious(shown_examples):
    assert calibration_of(header(), shown_examples) == CAUTIOUS


def test_with_enough_examples_it_is_fitted():
    assert calibration_of(header(), examples("abcde")) != CAUTIOUS


def test_with_one_person_the_fit_is_at_least_cautious():
    shown_examples = examples("a", trials=[str(n) for n in range(20)])
    calibration = calibration_of(header(), shown_examples)
    assert (
        calibration.temperature >= CAUTIOUS.temperature
        and calibration.doubt >= CAUTIOUS.doubt
        and not calibration.foreseen
    )


def test_of_many_examples_only_a_share_is_evaluated():
    shown_examples = examples([str(n) for n in range(10)], trials=[str(n) for n in range(30)])
    calibration_of(header(), shown_examples)
    assert MOST_EVALUATED / 2 <= len(EVALUATIONS) <= MOST_EVALUATED * 1.5
    assert {movement for _, (_, _, movement) in EVALUATIONS} == {0, 1}
    assert all(subject not in {s for s, _, _ in learned} for learned, (subject, _, _) in EVALUATIONS)


def test_only_one_facing_is_evaluated():
    calibration_of(header(4.0), examples("abc", facings=4))
    assert len(EVALUATIONS) == 12 and all(h.parameters["facings"] == 1.0 for h in HEADERS)


def test_calibration_leaves_the_model_unchanged():
    shown_examples = examples("abcde", facings=4)
    model = Spy.learn(header(4.0), shown_examples)
    calibrated = with_calibration(Spy, model, shown_examples)
    assert calibrated.learned == model.learned and calibrated.header.parameters == {"facings": 4.0}
    assert calibrated.header.calibration == calibration_of(header(4.0), shown_examples) != CAUTIOUS
    # The spy's posterior is uniform, and argmax takes the first.
    assert calibrated.header.provenance == {"tried": "20", "right": "10"}
