"""Trials: training and test people differ, an unknown onset hides the begin, and which movements are unlearned."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive, Recording, Span
from studies.evaluate import evaluate
from studies.performer import perform
from studies.report_text import stream_text
from studies.settings import EvaluationSettings, folds_of
from studies.stream import THRESHOLDS, judge_streams
from studies.trials import (
    FASTEST,
    SLOWEST,
    STANDING_S,
    EvaluationTrial,
    make_trials,
    splits,
    unlearned_and_background,
    with_labels,
)

RATE = 10.0
PARTS = ("left_hand", "right_hand", "head")


def recording(label="bow", subject="1", trial="1", frames=12, spans=()):
    """Everything moves at a constant speed, so that a position tells its time."""
    place = np.arange(frames, dtype=np.float32)[:, None, None] + np.arange(9, dtype=np.float32).reshape(3, 3)
    return Recording(place, RATE, label, subject, trial, spans)


def archive(subjects=("1", "2", "3", "10"), labels=("bow", "lunge")):
    return MotionArchive(PARTS, tuple(recording(label, subject) for subject in subjects for label in labels))


def shown(*recordings, onset_known=True, turn=0.0, seed=0):
    return make_trials(recordings, onset_known=onset_known, turn=turn, rng=np.random.default_rng(seed))


def test_only_the_requested_movements_are_left_and_spans_are_cut_out():
    spanned = recording("", "2", spans=(Span(0, 4, "bow"), Span(5, 9, "punch")))
    chosen = with_labels(MotionArchive(PARTS, (recording("lunge"), recording("punch"), spanned)), ("bow", "punch"))
    pieces = [(r.label, r.subject, len(r.positions)) for r in chosen.recordings]
    assert pieces == [("punch", "1", 12), ("bow", "2", 4), ("punch", "2", 4)] and chosen.body_parts == PARTS
    several = MotionArchive(PARTS, (recording("lunge"), recording("bow"), recording("")))
    with pytest.raises(BadInput, match=r"--labels: 'punch' is in no recording; known: lunge, bow$"):
        with_labels(several, ("bow", "punch"))


people = st.lists(st.sampled_from(["1", "2", "3", "10", "9"]), max_size=3)


@given(st.sets(st.sampled_from(["1", "2", "3", "10", "x"]), min_size=1), people, people, st.booleans())
def test_no_split_shares_a_person(subjects, train, test, leave_one_out):
    whole = archive(sorted(subjects))
    try:
        folds = list(splits(whole, train, test, leave_one_out))
    except BadInput as error:
        assert "\n" not in str(error)
        assert train or test or len(subjects) == 1
        return
    for fold in folds:
        learned, judged = {r.subject for r in fold.train.recordings}, {r.subject for r in fold.test}
        assert learned and judged and not learned & judged
        assert leave_one_out or not train or learned == set(train)
        assert leave_one_out or not test or judged == set(test)
        if not (train and test) and not (train and leave_one_out):
            assert len(fold.train.recordings) + len(fold.test) == len(whole.recordings)
    if leave_one_out:
        among = dict.fromkeys(train) or sorted(subjects, key=lambda s: (len(s), s))
        assert [{r.subject for r in f.test} for f in folds] == [{s} for s in among]
    else:
        assert len(folds) == 1
    if len(subjects) > 1 and not (train or test or leave_one_out):
        every_other = sorted(subjects, key=lambda s: (len(s), s))[::2]
        assert {r.subject for r in folds[0].train.recordings} == set(every_other)


@pytest.mark.parametrize(
    ("subjects", "train", "test", "leave_one_out", "error"),
    [
        ("1 2 3 10", ["9"], [], False, "subject '9': not in the archive; it has 1, 2, 3, 10"),
        ("1 2 3 10", [], ["9"], False, "subject '9'"),
        ("1 2 3 10", ["1", "2"], ["2", "3"], False, "subject '2': both in training and in test"),
        ("1 2 3 10", [], ["1", "2", "3", "10"], False, "no subject is left"),
        ("1 2 3 10", ["1", "2"], ["3"], True, "--leave-one-subject-out judges every person"),
        ("1 2 3 10", ["1"], [], True, "--leave-one-subject-out: 1 person only, '1'"),
        ("7", [], [], False, "no subject is left"),
    ],
)
def test_bad_splits_are_one_line(subjects, train, test, leave_one_out, error):
    with pytest.raises(BadInput, match=re.escape(error)):
        list(splits(archive(subjects.split()), train, test, leave_one_out))


@given(st.integers(0, 50), st.integers(1, 200), st.lists(st.floats(0, 1), min_size=2, max_size=9))
def test_frame_at_never_goes_back_nor_past_the_end(begin, length, fractions):
    trial = EvaluationTrial(recording(), begin, begin + length)
    frames = [trial.frame_at(f) for f in sorted(fractions)]
    assert frames == sorted(frames) and all(begin <= frame < begin + length for frame in frames)
    assert trial.frame_at(1.0) == begin + length - 1
    for fraction, frame in zip(sorted(fractions), frames, strict=True):
        count = frame - begin + 1
        assert count - 1 <= fraction * length + 1e-6 or count == 1  # less than a frame more than the fraction
        assert count >= fraction * length - 1e-6
    # Exact, too, where binary fractions are not: 0.07 * 100 is 7.000000000000001.
    assert [EvaluationTrial(recording(), 0, 10).frame_at(f) for f in (0.1, 0.2, 0.3, 0.6, 0.7)] == [0, 1, 2, 5, 6]
    assert EvaluationTrial(recording(), 0, 100).frame_at(0.07) == 6


@given(st.integers(0, 300), st.integers(2, 60))
def test_an_unknown_onset_keeps_the_movement_inside_begin_to_end(seed, frames):
    original = recording(frames=frames)
    (trial,) = shown(original, onset_known=False, seed=seed)
    whole, moving = trial.recording.positions, trial.recording.positions[trial.begin : trial.end]
    np.testing.assert_array_equal(moving[0], original.positions[0])
    steps = np.diff(moving[:, 0, 0])
    if len(moving) > 2:
        assert SLOWEST - 1e-3 <= steps[0] <= FASTEST + 1e-3
        np.testing.assert_allclose(steps, steps[0], atol=1e-3)
        assert original.positions[-1, 0, 0] - moving[-1, 0, 0] < FASTEST + 1e-3  # to its end
    for idle, place in ((whole[: trial.begin], moving[0]), (whole[trial.end :], moving[-1])):
        assert math.floor(STANDING_S[0] * RATE) <= len(idle) <= math.ceil(STANDING_S[1] * RATE)
        assert 0 < np.abs(idle - place).max() < 0.1  # trembles in place
    assert whole.dtype == np.float32 and np.isfinite(whole).all()
    assert (trial.recording.label, trial.recording.rate_hz) == ("bow", RATE)


def test_a_known_onset_shows_the_recording_as_it_is_or_turned_in_place():
    (trial,) = shown(recording())
    assert (trial.begin, trial.end, trial.name) == (0, 12, "bow 1.1")
    np.testing.assert_array_equal(trial.recording.positions, recording().positions)
    (trial,) = shown(recording(), turn=90.0)
    before, after = recording().positions, trial.recording.positions
    centre = before.reshape(-1, 3).mean(axis=0)
    np.testing.assert_allclose(after[..., 1], before[..., 1])
    np.testing.assert_allclose(after[..., 0] - centre[0], before[..., 2] - centre[2], atol=1e-4)
    np.testing.assert_allclose(after[..., 2] - centre[2], centre[0] - before[..., 0], atol=1e-4)


@pytest.mark.parametrize("onset_known", [True, False])
@pytest.mark.parametrize(("turn", "expected"), [(0.0, 0.0), (45.0, 45.0), (-90.0, 270.0), (None, None)])
def test_the_trial_knows_its_turn_and_the_seed_repeats_it(turn, expected, onset_known):
    one, again, other = (shown(*[recording()] * 5, onset_known=onset_known, turn=turn, seed=s) for s in (3, 3, 4))
    assert all(0 <= t.turn_deg < 360 and (expected is None or t.turn_deg == pytest.approx(expected)) for t in one)
    for a, b in zip(one, again, strict=True):
        np.testing.assert_array_equal(a.recording.positions, b.recording.positions)
        assert (a.begin, a.end) == (b.begin, b.end)
    if turn is None or not onset_known:
        pairs = zip(one, other, strict=True)
        assert not all(np.array_equal(a.recording.positions, b.recording.positions) for a, b in pairs)


def test_missing_positions_stay_missing():
    holed = recording(frames=20)
    holed.positions[5:9, 1] = np.nan
    (trial,) = shown(holed, onset_known=False, turn=30.0)
    moving = trial.recording.positions[trial.begin : trial.end]
    assert np.isnan(moving[:, 1]).any() and np.isfinite(moving[:, [0, 2]]).all()
    assert np.isfinite(trial.recording.positions[: trial.begin]).all()


KNOWN, LEARNED = ("a", "b", "c", "d", "e"), ("a", "b")


@pytest.mark.parametrize(
    ("unlearned", "background", "expected"),
    [
        ("", "", ((), ())),
        ("others", "", (("c", "d", "e"), ())),
        ("others", "d", (("c", "e"), ("d",))),
    ],
)
def test_unlearned_and_background_movements(unlearned, background, expected):
    assert unlearned_and_background(unlearned, background, LEARNED, KNOWN) == expected


def test_a_number_is_drawn_from_the_unlearned_and_not_shown():
    draws = set()
    for seed in range(20):
        rest, background = unlearned_and_background("others", "2", LEARNED, KNOWN, seed)
        assert len(background) == 2 and sorted(rest + background) == ["c", "d", "e"]
        assert unlearned_and_background("others", "2", LEARNED, KNOWN, seed) == (rest, background)
        draws.add(background)
    assert len(draws) == 3


@pytest.mark.parametrize(
    ("unlearned", "background", "error"),
    [
        ("a", "", "--unlearned: 'a' is one of the learned movements"),
        ("others", "b", "--background-labels: 'b' is one of the learned movements"),
        ("c,d", "d", "--background-labels: 'd' is also in --unlearned"),
        ("others", "3", "--background-labels 3: needs 1 to one less than the 3 movements"),
        ("", "1", "--background-labels 1: needs 1 to one less than the 0 movements"),
        ("others", "0", "--background-labels 0"),
    ],
)
def test_contradictions_are_one_line(unlearned, background, error):
    with pytest.raises(BadInput, match=r"\A[^\n]*\Z") as caught:
        unlearned_and_background(unlearned, background, LEARNED, KNOWN)
    assert error in str(caught.value)


@pytest.fixture(scope="module")
def performed():
    return perform(("1", "2", "3"), ("ok", "shake", "lunging", "byebye"), trials=1, seed=3)


def settings(**changes):
    common = {"labels": ("ok", "shake"), "train_subjects": ("1", "2"), "calibrated": False, "background": ("lunging",)}
    return EvaluationSettings(views=(parse_view("door"),), **{**common, **changes})


def test_the_background_is_learned_from_the_training_people_and_not_judged(performed):
    (fold,) = folds_of(performed, settings(), ("ok", "shake", "byebye"))
    assert [r.subject for r in fold.train.recordings if r.label == "lunging"] == ["1", "2"]
    assert {(r.subject, r.label) for r in fold.test} == {("3", label) for label in ("ok", "shake", "byebye")}
    trials = evaluate(performed, settings()).trials
    assert [r.trial.recording.label for r in trials] == ["ok", "shake"]
    assert all((r.unlearned > 0).all() for r in trials)


def test_a_stream_reports_each_threshold(performed):
    figures = judge_streams(performed, settings(unlearned=("byebye",)))
    assert figures["unlearned"] == 1 and {"recall_last_word", "unlearned_named_last_word"} <= figures.keys()
    rows = figures["by_threshold"]
    assert [row["threshold"] for row in rows] == list(THRESHOLDS)
    (usual,) = [row for row in rows if row["threshold"] == 0.6]
    assert usual == {name: figures[name] for name in usual if name != "threshold"} | {"threshold": 0.6}
    text = "\n".join(stream_text(figures))
    assert text.count("0.95 ") == 1 and "by the last word" in text
    assert judge_streams(performed, settings())["by_threshold"] == []


def test_the_training_peoples_streams_are_learned_from_and_no_others():
    spanned = [recording("", s, spans=(Span(0, 4, "bow"), Span(5, 9, "lunge"))) for s in ("1", "2", "3")]
    whole = MotionArchive(PARTS, (*spanned, recording("bow", "1")))
    chosen = EvaluationSettings(views=(parse_view("door"),), labels=("bow", "lunge"), leave_one_subject_out=True)
    for fold in folds_of(whole, chosen, chosen.labels):
        (judged,) = {r.subject for r in fold.test}
        assert [r.subject for r in fold.streams] == [r.subject for r in spanned if r.subject != judged]
        assert all(r.spans for r in fold.streams)
