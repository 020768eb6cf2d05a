"""Trying a model on who it has not learned from: who is left out, and who is judged by whom."""

from collections import Counter

import numpy as np
import pytest

from common.vocabulary import Vocabulary
from observer.learning.cross_validation import MOST_EVALUATED, estimate_calibration, with_calibration
from observer.model.base import Example, Header
from observer.model.posterior_calibration import CAUTIOUS

LABELS = ("bow", "lunge")
TOLD: list[tuple[frozenset[tuple[str, str, int]], tuple[str, str, int]]] = []
"""Who was learned from, and who was judged: (subject, trial, movement)."""
HEADERS: list[Header] = []


class Spy:
    """A model whose examples are shown as tracks that name themselves."""

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
        TOLD.append((self._learned, tracks))


@pytest.fixture(autouse=True)
def forgotten():
    TOLD.clear()
    HEADERS.clear()


def header(facings=1.0):
    return Header("spy", Vocabulary(LABELS), "door", np.eye(3, 4), 15.0, ("head",), {"facings": facings})


def example(subject, trial, movement, facing=0):
    return Example([(subject, trial, movement)], movement, facing, subject, trial)


def examples(subjects, trials=("1", "2"), facings=1):
    return [example(s, t, m, k) for k in range(facings) for s in subjects for t in trials for m in range(len(LABELS))]


def test_nobody_is_judged_by_a_model_that_learned_from_him():
    shown = examples("abcd")
    estimate_calibration(Spy, header(), shown)
    assert Counter(judged for _, judged in TOLD) == Counter((e.subject, e.trial, e.movement) for e in shown)
    for learned, (subject, _, _) in TOLD:
        assert {s for s, _, _ in learned} == set("abcd") - {subject}


def test_of_one_person_alone_one_recording_of_each_movement_is_left_out_in_turn():
    shown = examples("a", trials=("1", "2", "3"))
    estimate_calibration(Spy, header(), shown)
    assert len(TOLD) == len(shown)
    for learned, judged in TOLD:
        assert judged not in learned and len(learned) == 4
        assert {m for _, _, m in learned} == {0, 1}


def test_where_one_person_alone_shows_a_movement_recordings_are_left_out_in_turn():
    shown = [*examples("ab", trials=("1", "2")), example("a", "3", 1), example("b", "3", 1)]
    shown = [e for e in shown if e.movement == 1 or e.subject == "a"]
    assert {e.subject for e in shown if e.movement == 0} == {"a"}
    estimate_calibration(Spy, header(), shown)
    assert len(TOLD) == len(shown)
    assert all(judged not in learned and {m for _, _, m in learned} == {0, 1} for learned, judged in TOLD)


def test_the_only_recording_of_a_movement_is_always_learned_from_and_never_judged():
    shown = [example("a", "1", 0), *(example("a", str(t), 1) for t in range(3))]
    estimate_calibration(Spy, header(), shown)
    assert [judged for _, judged in TOLD] == [("a", str(t), 1) for t in range(3)]
    assert all(("a", "1", 0) in learned and judged not in learned for learned, judged in TOLD)


@pytest.mark.parametrize("shown", [examples("a", trials=("1",)), examples("ab"), examples("a", trials=("1", "2"))])
def test_who_can_hardly_be_tried_is_believed_less(shown):
    assert estimate_calibration(Spy, header(), shown) == CAUTIOUS


def test_with_enough_of_them_it_is_fitted():
    assert estimate_calibration(Spy, header(), examples("abcde")) != CAUTIOUS


def test_what_was_found_of_one_person_alone_makes_nobody_surer_than_that():
    shown = examples("a", trials=[str(n) for n in range(20)])
    found = estimate_calibration(Spy, header(), shown)
    assert found.temperature >= CAUTIOUS.temperature and found.doubt >= CAUTIOUS.doubt and not found.foreseen


def test_of_very_many_only_some_are_judged_though_all_are_left_out():
    shown = examples([str(n) for n in range(10)], trials=[str(n) for n in range(30)])
    estimate_calibration(Spy, header(), shown)
    assert MOST_EVALUATED / 2 <= len(TOLD) <= MOST_EVALUATED * 1.5
    assert {movement for _, (_, _, movement) in TOLD} == {0, 1}
    assert all(subject not in {s for s, _, _ in learned} for learned, (subject, _, _) in TOLD)


def test_facing_one_way_is_enough():
    estimate_calibration(Spy, header(4.0), examples("abc", facings=4))
    assert len(TOLD) == 12 and all(h.parameters["facings"] == 1.0 for h in HEADERS)


def test_the_believable_model_is_the_same_but_for_its_certainty():
    shown = examples("abcde", facings=4)
    model = Spy.learn(header(4.0), shown)
    told = with_calibration(Spy, model, shown)
    assert told.learned == model.learned and told.header.parameters == {"facings": 4.0}
    assert told.header.calibration == estimate_calibration(Spy, header(4.0), shown) != CAUTIOUS
    # The spy holds all for equally likely, and takes the first.
    assert told.header.provenance == {"tried": "20", "right": "10"}
