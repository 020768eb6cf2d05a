"""Faults: what each faulty judge says instead, and that nobody else is touched."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from observer.tracks import Frame, Tracks
from studies.faults import FAULTS, LATE_S, Hidden, disturb, fault_named

VIEWS = ("door", "wheel", "table")
RATE = 5.0
M = 4


def beliefs(seed=0, lengths=(8, 12, 3)):
    rng = np.random.default_rng(seed)
    return [rng.dirichlet(np.ones(M), size=(n, len(VIEWS))) for n in lengths]


def is_belief(p):
    return np.isfinite(p).all() and (p >= 0).all() and np.allclose(p.sum(axis=-1), 1)


@given(st.dictionaries(st.sampled_from(VIEWS), st.sampled_from(sorted(FAULTS))), st.integers(0, 99))
def test_only_the_faulty_views_change_and_all_stay_beliefs(faults, seed):
    before, kept = beliefs(seed), beliefs(seed)
    after = disturb(before, VIEWS, faults, RATE, seed)
    again = disturb(before, VIEWS, faults, RATE, seed)
    for n, (own, then) in enumerate(zip(before, after, strict=True)):
        np.testing.assert_array_equal(own, kept[n])
        np.testing.assert_array_equal(then, again[n])
        assert then.shape == own.shape and is_belief(then)
        for column, view in enumerate(VIEWS):
            assert np.array_equal(own[:, column], then[:, column]) == (view not in faults)


def test_wrong_is_what_it_believed_of_another_trial():
    before = beliefs()
    after = disturb(before, VIEWS, {"wheel": "wrong"}, RATE, 1)
    for n, then in enumerate(after):
        said = then[:, 1]

        def could_be(other, said=said):
            place = np.minimum(np.arange(len(said)), len(other) - 1)
            return np.array_equal(said, other[place, 1])

        assert [could_be(other) for k, other in enumerate(before) if k != n].count(True) == 1


def test_wrong_draws_from_all_other_trials():
    many = beliefs(lengths=(1,) * 30)
    drawn = [int(then[0, 0, 0] == other[0, 0, 0]) for then in disturb(many, VIEWS, {"door": "wrong"}, RATE, 0)
             for other in many]  # fmt: skip
    table = np.array(drawn).reshape(30, 30)
    assert (table.sum(axis=1) == 1).all() and not table.diagonal().any()
    shifts = {(int(row.argmax()) - n) % 30 for n, row in enumerate(table)}
    assert len(shifts) > 5


def test_a_single_trial_can_only_be_itself():
    (only,) = beliefs(lengths=(6,))
    (after,) = disturb([only], VIEWS, {"door": "wrong"}, RATE, 0)
    np.testing.assert_array_equal(after, only)


def test_silent_says_the_prior():
    for then in disturb(beliefs(), VIEWS, {"door": "silent"}, RATE, 0):
        assert (then[:, 0] == 1 / M).all()


def test_late_says_everything_a_second_late():
    before = beliefs()
    delay = round(LATE_S * RATE)
    for own, then in zip(before, disturb(before, VIEWS, {"table": "late"}, RATE, 0), strict=True):
        assert (then[:delay, 2] == 1 / M).all()
        np.testing.assert_array_equal(then[delay:, 2], own[: max(len(own) - delay, 0), 2])


def test_noise_is_new_in_every_frame_and_owes_nothing_to_the_person():
    one, other = ([then[:, 0] for then in disturb(beliefs(seed), VIEWS, {"door": "noise"}, RATE, 7)] for seed in (0, 1))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)
        assert len(np.unique(a, axis=0)) == len(a)
    entropies = -(np.concatenate(one) * np.log2(np.maximum(np.concatenate(one), 1e-300))).sum(axis=1)
    assert entropies.min() < 0.5 < entropies.max()


def test_faults_are_named_view_by_view():
    assert fault_named("door=wrong", VIEWS) == ("door", "wrong")
    assert fault_named("yaw:45,pitch:10=late", ("yaw:45,pitch:10",)) == ("yaw:45,pitch:10", "late")
    assert fault_named("a=b=late", ("a=b",)) == ("a=b", "late")


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("door", "VIEW=KIND is wanted, VIEW one of door, wheel, table"),
        ("roof=late", "VIEW one of door, wheel, table"),
        ("=late", "VIEW=KIND is wanted"),
        ("door=", "'' is no fault; known: wrong, noise, silent, late, hidden"),
        ("door=asleep", "'asleep' is no fault"),
    ],
)
def test_bad_faults_are_refused(text, rule):
    with pytest.raises(BadInput, match=rule):
        fault_named(text, VIEWS)


class Counting:
    body_parts = ("head",)

    def update(self, frame):
        return Tracks(np.array([[float(frame.captured_ns), 1.0]]))


def test_who_is_hidden_sees_nothing_in_those_frames_and_loses_none():
    tracker = Hidden(Counting(), 2, 4)
    seen = [tracker.update(Frame(n, np.zeros(0))).centres[0, 0] for n in range(6)]
    assert np.array_equal(seen, [0, 1, np.nan, np.nan, 4, 5], equal_nan=True)
