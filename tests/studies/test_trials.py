"""Trials: nobody is judged who was learned from, and what an unknown onset hides and what not."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording, Span
from studies.trials import FASTEST, IDLE_S, SLOWEST, EvaluationTrial, make_trials, splits, with_labels

RATE = 10.0
PARTS = ("left_hand", "right_hand", "head")


def recording(label="bow", subject="1", trial="1", frames=12, spans=()):
    """Everything moves on at a constant speed, so that a place tells its time."""
    place = np.arange(frames, dtype=np.float32)[:, None, None] + np.arange(9, dtype=np.float32).reshape(3, 3)
    return Recording(place, RATE, label, subject, trial, spans)


def archive(subjects=("1", "2", "3", "10"), labels=("bow", "lunge")):
    return MotionArchive(PARTS, tuple(recording(label, subject) for subject in subjects for label in labels))


def seeded(seed=0):
    return np.random.default_rng(seed)


# Whose is what


def test_only_the_wanted_movements_are_left_and_spans_are_cut_out():
    spanned = recording("", "2", spans=(Span(0, 4, "bow"), Span(5, 9, "punch")))
    chosen = with_labels(MotionArchive(PARTS, (recording("lunge"), recording("punch"), spanned)), ("bow", "punch"))
    assert [(r.label, r.subject, len(r.positions)) for r in chosen.recordings] == [
        ("punch", "1", 12), ("bow", "2", 4), ("punch", "2", 4)
    ]  # fmt: skip
    assert chosen.body_parts == PARTS


def test_a_movement_that_nobody_performs_is_told_the_known_ones():
    several = MotionArchive(PARTS, (recording("lunge"), recording("bow"), recording("")))
    with pytest.raises(BadInput, match=r"--labels: 'punch' is in no recording; known: lunge, bow$"):
        with_labels(several, ("bow", "punch"))


@given(
    st.sets(st.sampled_from(["1", "2", "3", "10", "x"]), min_size=1),
    st.lists(st.sampled_from(["1", "2", "3", "10", "9"]), max_size=3),
    st.lists(st.sampled_from(["1", "2", "3", "10", "9"]), max_size=3),
    st.booleans(),
)
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
        assert fold.train.body_parts == PARTS
        if train and not leave_one_out:
            assert learned == set(train)
        if test and not leave_one_out:
            assert judged == set(test)
        if not (train and test) and not (train and leave_one_out):
            assert len(fold.train.recordings) + len(fold.test) == len(whole.recordings)
    if leave_one_out:
        assert [{r.subject for r in f.test} for f in folds] == [
            {s} for s in (dict.fromkeys(train) or sorted(subjects, key=lambda s: (len(s), s)))
        ]
    else:
        assert len(folds) == 1


def test_without_names_every_other_person_is_learned_from():
    (fold,) = splits(archive(("10", "1", "3", "2")), (), (), False)
    assert {r.subject for r in fold.train.recordings} == {"1", "3"} and {r.subject for r in fold.test} == {"2", "10"}


@pytest.mark.parametrize(
    ("train", "test", "leave_one_out", "rule"),
    [
        (["9"], [], False, "subject '9': not in the archive; it has 1, 2, 3, 10"),
        ([], ["9"], False, "subject '9'"),
        (["1", "2"], ["2", "3"], False, "subject '2': both in training and in test"),
        (["1", "2", "3", "10"], [], False, "no subject is left"),
        ([], ["1", "2", "3", "10"], False, "no subject is left"),
        (["1", "2"], ["3"], True, "--leave-one-subject-out judges every person"),
        (["1"], [], True, "--leave-one-subject-out: 1 person only, '1'"),
    ],
)
def test_bad_splits_are_refused_in_one_line(train, test, leave_one_out, rule):
    with pytest.raises(BadInput, match=re.escape(rule)):
        list(splits(archive(), train, test, leave_one_out))


def test_one_person_alone_cannot_be_split():
    for leave_one_out, rule in ((True, "1 person only, '7'"), (False, "no subject is left")):
        with pytest.raises(BadInput, match=rule):
            list(splits(archive(("7",)), (), (), leave_one_out))


# How far one may look


@given(st.integers(0, 50), st.integers(1, 200), st.lists(st.floats(0, 1), min_size=2, max_size=9))
def test_frame_at_never_goes_back_nor_past_the_end(begin, length, fractions):
    trial = EvaluationTrial(recording(), begin, begin + length)
    frames = [trial.frame_at(f) for f in sorted(fractions)]
    assert frames == sorted(frames)
    assert all(begin <= frame < begin + length for frame in frames)
    assert trial.frame_at(1.0) == begin + length - 1
    for fraction, frame in zip(sorted(fractions), frames, strict=True):
        seen = frame - begin + 1
        assert seen - 1 <= fraction * length + 1e-6 or seen == 1  # not a whole frame more than the fraction
        assert seen >= fraction * length - 1e-6


def test_frame_at_is_exact_where_binary_fractions_are_not():
    assert [EvaluationTrial(recording(), 0, 10).frame_at(f) for f in (0.1, 0.2, 0.3, 0.6, 0.7, 1.0)] == [
        0,
        1,
        2,
        5,
        6,
        9,
    ]
    assert EvaluationTrial(recording(), 0, 100).frame_at(0.07) == 6  # 0.07 * 100 is 7.000000000000001


# What is shown


def test_a_known_onset_shows_the_recording_as_it_is():
    (trial,) = make_trials([recording()], onset_known=True, turn=0.0, rng=seeded())
    assert (trial.begin, trial.end, trial.name) == (0, 12, "bow 1.1")
    np.testing.assert_array_equal(trial.recording.positions, recording().positions)


@given(st.integers(0, 300), st.integers(2, 60))
def test_an_unknown_onset_keeps_the_movement_inside_begin_to_end(seed, frames):
    original = recording(frames=frames)
    (trial,) = make_trials([original], onset_known=False, turn=0.0, rng=seeded(seed))
    shown, moving = trial.recording.positions, trial.recording.positions[trial.begin : trial.end]
    np.testing.assert_array_equal(moving[0], original.positions[0])
    steps = np.diff(moving[:, 0, 0])
    if len(moving) > 2:
        assert SLOWEST - 1e-3 <= steps[0] <= FASTEST + 1e-3
        np.testing.assert_allclose(steps, steps[0], atol=1e-3)
        assert original.positions[-1, 0, 0] - moving[-1, 0, 0] < FASTEST + 1e-3  # to its end
    for idle, place in ((shown[: trial.begin], moving[0]), (shown[trial.end :], moving[-1])):
        assert math.floor(IDLE_S[0] * RATE) <= len(idle) <= math.ceil(IDLE_S[1] * RATE)
        assert 0 < np.abs(idle - place).max() < 0.1  # trembles, and does not leave
    assert shown.dtype == np.float32 and np.isfinite(shown).all()
    assert (trial.recording.label, trial.recording.rate_hz) == ("bow", RATE)


def test_as_many_are_slower_as_are_faster():
    shown = make_trials([recording(frames=200)] * 400, onset_known=False, turn=0.0, rng=seeded(1))
    lengths = np.array([t.end - t.begin for t in shown])
    middle = 200 / math.sqrt(SLOWEST * FASTEST)
    assert abs((lengths < middle).mean() - 0.5) < 0.1
    assert lengths.min() < 200 / FASTEST * 1.05 and lengths.max() > 200 / SLOWEST * 0.95


def test_a_performer_is_turned_where_he_stands():
    (trial,) = make_trials([recording()], onset_known=True, turn=90.0, rng=seeded())
    before, after = recording().positions, trial.recording.positions
    centre = before.reshape(-1, 3).mean(axis=0)
    np.testing.assert_allclose(after[..., 1], before[..., 1])
    np.testing.assert_allclose(after[..., 0] - centre[0], before[..., 2] - centre[2], atol=1e-4)
    np.testing.assert_allclose(after[..., 2] - centre[2], centre[0] - before[..., 0], atol=1e-4)


def test_any_facing_is_drawn_for_each_trial_and_keeps_distances():
    shown = make_trials([recording()] * 20, onset_known=True, turn=None, rng=seeded())
    first_frames = {tuple(t.recording.positions[0, 0].round(3)) for t in shown}
    assert len(first_frames) == 20
    assert len({t.turn_deg for t in shown}) == 20
    for trial in shown:
        span = np.linalg.norm(np.ptp(trial.recording.positions[:, 0], axis=0)[[0, 2]])
        assert span == pytest.approx(11 * math.sqrt(2), rel=1e-3)


@pytest.mark.parametrize("onset_known", [True, False])
@pytest.mark.parametrize(("turn", "told"), [(0.0, 0.0), (45.0, 45.0), (-90.0, 270.0), (None, None)])
def test_the_truth_knows_how_far_he_was_turned(turn, told, onset_known):
    (trial,) = make_trials([recording()], onset_known=onset_known, turn=turn, rng=seeded())
    assert 0 <= trial.turn_deg < 360 and (told is None or trial.turn_deg == pytest.approx(told))


def test_the_angle_that_is_told_is_the_one_he_is_turned_by():
    (trial,) = make_trials([recording()], onset_known=True, turn=None, rng=seeded())
    (again,) = make_trials([recording()], onset_known=True, turn=trial.turn_deg, rng=seeded())
    np.testing.assert_allclose(again.recording.positions, trial.recording.positions, atol=1e-4)


@pytest.mark.parametrize("turn", [0.0, 45.0, None])
@pytest.mark.parametrize("onset_known", [True, False])
def test_the_seed_gives_the_same_again(turn, onset_known):
    def shown(seed):
        return make_trials([recording()] * 5, onset_known=onset_known, turn=turn, rng=seeded(seed))

    for one, other in zip(shown(3), shown(3), strict=True):
        np.testing.assert_array_equal(one.recording.positions, other.recording.positions)
        assert (one.begin, one.end) == (other.begin, other.end)
    if turn is None or not onset_known:
        pairs = zip(shown(3), shown(4), strict=True)
        assert not all(np.array_equal(a.recording.positions, b.recording.positions) for a, b in pairs)


def test_what_was_not_seen_stays_unseen():
    holed = recording(frames=20)
    holed.positions[5:9, 1] = np.nan
    (trial,) = make_trials([holed], onset_known=False, turn=30.0, rng=seeded())
    moving = trial.recording.positions[trial.begin : trial.end]
    assert np.isnan(moving[:, 1]).any() and np.isfinite(moving[:, [0, 2]]).all()
    assert np.isfinite(trial.recording.positions[: trial.begin]).all()
