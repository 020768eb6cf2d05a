"""Faults: what each faulty judge says instead, and that nobody else is touched."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from observer.tracks import Frame, Tracks
from studies.faults import FAULTS, LATE_S, ObserverOutputs, OccludedTracker, disturb, parse_fault

VIEWS = ("door", "wheel", "table")
RATE = 5.0
M = 4


def said(seed=0, lengths=(8, 12, 3), facings=2):
    """What was said in trials of these lengths; without facings, nothing of them nor of the unlearned."""
    rng = np.random.default_rng(seed)
    result = []
    for n in lengths:
        p = rng.dirichlet(np.ones(M), size=(n, len(VIEWS)))
        facing = rng.dirichlet(np.ones(facings), size=(n, len(VIEWS), M)) if facings else None
        result.append(ObserverOutputs(p, facing, rng.random((n, len(VIEWS))) if facings else None))
    return result


def parts_of(said):
    return [part for part in (said.p, said.facing, said.unlearned) if part is not None]


def is_belief(p):
    return np.isfinite(p).all() and (p >= 0).all() and np.allclose(p.sum(axis=-1), 1)


@given(
    st.dictionaries(st.sampled_from(VIEWS), st.sampled_from(sorted(FAULTS))),
    st.integers(0, 99),
    st.sampled_from([0, 2]),
)
def test_only_the_faulty_views_change_and_all_stay_beliefs(faults, seed, facings):
    before, kept = said(seed, facings=facings), said(seed, facings=facings)
    after = disturb(before, VIEWS, faults, RATE, seed)
    again = disturb(before, VIEWS, faults, RATE, seed)
    for n, (own, then) in enumerate(zip(before, after, strict=True)):
        for was, stayed, now, repeated in zip(*map(parts_of, (own, kept[n], then, again[n])), strict=True):
            np.testing.assert_array_equal(was, stayed)
            np.testing.assert_array_equal(now, repeated)
            assert now.shape == was.shape
            for column, view in enumerate(VIEWS):
                assert view in faults or np.array_equal(was[:, column], now[:, column])
        assert is_belief(then.p) and (then.facing is None or is_belief(then.facing))
        for column, view in enumerate(VIEWS):
            assert np.array_equal(own.p[:, column], then.p[:, column]) == (view not in faults)


def test_wrong_is_what_it_believed_of_another_trial():
    before = said()
    after = disturb(before, VIEWS, {"wheel": "wrong"}, RATE, 1)
    for n, then in enumerate(after):

        def could_be(other, then=then):
            place = np.minimum(np.arange(len(then.p)), len(other.p) - 1)
            pairs = zip(parts_of(then), parts_of(other), strict=True)
            return all(np.array_equal(now[:, 1], whole[place, 1]) for now, whole in pairs)

        assert [could_be(other) for k, other in enumerate(before) if k != n].count(True) == 1


def test_wrong_draws_from_all_other_trials():
    many = said(lengths=(1,) * 30)
    drawn = [int(then.p[0, 0, 0] == other.p[0, 0, 0]) for then in disturb(many, VIEWS, {"door": "wrong"}, RATE, 0)
             for other in many]  # fmt: skip
    table = np.array(drawn).reshape(30, 30)
    assert (table.sum(axis=1) == 1).all() and not table.diagonal().any()
    shifts = {(int(row.argmax()) - n) % 30 for n, row in enumerate(table)}
    assert len(shifts) > 5


def test_a_single_trial_can_only_be_itself():
    (only,) = said(lengths=(6,))
    (after,) = disturb([only], VIEWS, {"door": "wrong"}, RATE, 0)
    np.testing.assert_array_equal(after.p, only.p)


def test_silent_says_the_prior_of_all_and_nothing_of_what_was_not_learned():
    for then in disturb(said(), VIEWS, {"door": "silent"}, RATE, 0):
        assert (then.p[:, 0] == 1 / M).all() and (then.facing[:, 0] == 1 / 2).all()
        assert np.isnan(then.unlearned[:, 0]).all() and np.isfinite(then.unlearned[:, 1:]).all()


def test_late_says_everything_a_second_late():
    before = said()
    delay = round(LATE_S * RATE)
    for own, then in zip(before, disturb(before, VIEWS, {"table": "late"}, RATE, 0), strict=True):
        assert (then.p[:delay, 2] == 1 / M).all() and (then.facing[:delay, 2] == 1 / 2).all()
        assert np.isnan(then.unlearned[:delay, 2]).all()
        for was, now in zip(parts_of(own), parts_of(then), strict=True):
            np.testing.assert_array_equal(now[delay:, 2], was[: max(len(was) - delay, 0), 2])


def test_noise_is_new_in_every_frame_and_owes_nothing_to_the_person():
    one, other = ([then.p[:, 0] for then in disturb(said(seed), VIEWS, {"door": "noise"}, RATE, 7)] for seed in (0, 1))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)
        assert len(np.unique(a, axis=0)) == len(a)
    entropies = -(np.concatenate(one) * np.log2(np.maximum(np.concatenate(one), 1e-300))).sum(axis=1)
    assert entropies.min() < 0.5 < entropies.max()


def test_noise_of_facing_owes_nothing_to_the_person_either():
    one, other = (
        [then.facing[:, 0] for then in disturb(said(seed), VIEWS, {"door": "noise"}, RATE, 7)] for seed in (0, 1)
    )
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_faults_are_named_view_by_view():
    assert parse_fault("door=wrong", VIEWS) == ("door", "wrong")
    assert parse_fault("yaw:45,pitch:10=late", ("yaw:45,pitch:10",)) == ("yaw:45,pitch:10", "late")
    assert parse_fault("a=b=late", ("a=b",)) == ("a=b", "late")


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("door", "VIEW=KIND is expected, VIEW one of door, wheel, table"),
        ("roof=late", "VIEW one of door, wheel, table"),
        ("=late", "VIEW=KIND is expected"),
        ("door=", "unknown fault ''; known: wrong, noise, silent, late, hidden"),
        ("door=asleep", "unknown fault 'asleep'"),
    ],
)
def test_bad_faults_are_refused(text, rule):
    with pytest.raises(BadInput, match=rule):
        parse_fault(text, VIEWS)


class Counting:
    body_parts = ("head",)

    def update(self, frame):
        return Tracks(np.array([[float(frame.captured_ns), 1.0]]))


def test_who_is_hidden_sees_nothing_in_those_frames_and_loses_none():
    tracker = OccludedTracker(Counting(), 2, 4)
    seen = [tracker.update(Frame(n, np.zeros(0))).centres[0, 0] for n in range(6)]
    assert np.array_equal(seen, [0, 1, np.nan, np.nan, 4, 5], equal_nan=True)
