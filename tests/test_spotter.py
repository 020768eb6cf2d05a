"""The sliding-window spotter that our observers are compared with: its windows, its verdicts, its people."""

import importlib.util

import numpy as np
import pytest

from benchmarks.comparisons.classifiers import spotter
from benchmarks.comparisons.classifiers.comparison import PeerOptions
from benchmarks.comparisons.classifiers.spotter import spot_streams
from benchmarks.comparisons.classifiers.spotter_windows import (
    ELSEWHERE,
    JITTERED,
    LENGTHS,
    PREFIXES,
    SHORTEST,
    choose_windows,
    is_elsewhere,
    window_lengths,
)
from benchmarks.comparisons.classifiers.window_classifier import StreamProbabilities
from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive
from studies.performer import perform
from studies.settings import EvaluationSettings
from studies.trials import strung

LABELS = ("ok", "shake")
RATE = 30.0
with_aeon = pytest.mark.skipif(
    importlib.util.find_spec("aeon") is None, reason="aeon is not installed: make test-peers brings it"
)


@pytest.fixture(scope="module")
def archive():
    """One stream for each of three people."""
    whole = perform(("1", "2", "3"), LABELS, trials=3, seed=3)
    return MotionArchive(whole.body_parts, tuple(strung(whole.recordings, np.random.default_rng(1))))


def settings_of(**options):
    views = (parse_view("door"), parse_view("wheel"))
    return EvaluationSettings(views=views, labels=LABELS, **({"leave_one_subject_out": True} | options))


def test_training_windows_are_spans_their_first_parts_and_something_else(archive):
    stream = archive.recordings[0]
    windows = choose_windows(stream, window_lengths([stream]), LABELS, np.random.default_rng(0))
    assert all(0 <= w.begin < w.end <= len(stream.positions) and w.end - w.begin >= SHORTEST for w in windows)
    for movement, label in enumerate(LABELS):
        own = [span for span in stream.spans if span.label == label]
        shown = [w for w in windows if w.movement == movement]
        assert len(shown) == len(own) * (JITTERED + len(PREFIXES))
        assert all(max(min(w.end, s.end) - max(w.begin, s.start) for s in own) > 0 for w in shown)
    other = [w for w in windows if w.movement == len(LABELS)]
    assert len(other) == ELSEWHERE * len(stream.spans)
    assert all(is_elsewhere(w.begin, w.end, span) for w in other for span in stream.spans)


def test_nobody_is_judged_by_what_they_taught_and_the_threshold_is_chosen_on_others(archive, monkeypatch):
    """Parts are recorded in place of learning; every stream gets "something else"."""
    parts = []

    def nothing(part):
        parts.append(part)
        p = np.zeros((2, LENGTHS, len(LABELS) + 1))
        p[:, :, -1] = 1
        return [StreamProbabilities(np.array([10, 20]), p) for _ in part.judged]

    monkeypatch.setattr(spotter, "judge_part", nothing)
    score = spot_streams(archive, settings_of(), PeerOptions(), lambda *_: None)
    assert (score.right, score.false, score.movements) == (0, 0, 18)
    people = [({r.subject for r in p.learned}, {r.subject for r in p.judged}) for p in parts]
    assert all(not learned & judged and learned | judged == {"1", "2", "3"} for learned, judged in people)
    assert [len(judged) for _, judged in people] == [1, 1, 2, 2, 1, 1, 1, 1, 2, 2], "1 and 2 share the pair"
    parts.clear()
    spot_streams(
        archive, settings_of(leave_one_subject_out=False, train_subjects=("1", "2")), PeerOptions(), lambda *_: None
    )
    assert [({r.subject for r in p.learned}, {r.subject for r in p.judged}) for p in parts[::2]] == [
        ({"1", "2"}, {"3"}),
        ({"2"}, {"1", "3"}),
    ]


@with_aeon
def test_the_spotter_finds_the_movements_of_a_person_whom_it_does_not_know(archive):
    score = spot_streams(archive, settings_of(), PeerOptions(fast=True), lambda *_: None)
    assert score.movements == 18 and score.f1 > 0.7
