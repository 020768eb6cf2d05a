"""Faults: the outputs of each faulty observer, and that the others stay untouched."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from studies.faults import FAULT_DELAY_S, FAULTS, ObserverOutputs, disturb, parse_fault

VIEWS = ("door", "wheel", "table")
RATE = 5.0
M = 4


def outputs(seed=0, lengths=(8, 12, 3), facings=2):
    """Outputs in trials of these lengths; with facings=0, neither facing nor unlearned."""
    rng = np.random.default_rng(seed)
    result = []
    for n in lengths:
        p = rng.dirichlet(np.ones(M), size=(n, len(VIEWS)))
        facing = rng.dirichlet(np.ones(facings), size=(n, len(VIEWS), M)) if facings else None
        result.append(ObserverOutputs(p, facing, rng.random((n, len(VIEWS))) if facings else None))
    return result


def parts_of(one):
    return [part for part in (one.p, one.facing, one.unlearned) if part is not None]


def is_distribution(p):
    return np.isfinite(p).all() and (p >= 0).all() and np.allclose(p.sum(axis=-1), 1)


@given(
    st.dictionaries(st.sampled_from(VIEWS), st.sampled_from(sorted(FAULTS))),
    st.integers(0, 99),
    st.sampled_from([0, 2]),
)
def test_only_the_faulty_views_change_and_all_stay_distributions(faults, seed, facings):
    before, unchanged = outputs(seed, facings=facings), outputs(seed, facings=facings)
    after, again = (disturb(before, VIEWS, faults, RATE, seed) for _ in range(2))
    for n, (own, then) in enumerate(zip(before, after, strict=True)):
        for was, stayed, now, repeated in zip(*map(parts_of, (own, unchanged[n], then, again[n])), strict=True):
            np.testing.assert_array_equal(was, stayed)
            np.testing.assert_array_equal(now, repeated)
            assert now.shape == was.shape
            for column, view in enumerate(VIEWS):
                assert view in faults or np.array_equal(was[:, column], now[:, column])
        assert is_distribution(then.p) and (then.facing is None or is_distribution(then.facing))
        for column, view in enumerate(VIEWS):
            assert np.array_equal(own.p[:, column], then.p[:, column]) == (view not in faults)


def test_wrong_is_the_output_of_another_trial():
    before = outputs()
    for n, then in enumerate(disturb(before, VIEWS, {"wheel": "wrong"}, RATE, 1)):

        def could_be(other, then=then):
            place = np.minimum(np.arange(len(then.p)), len(other.p) - 1)
            pairs = zip(parts_of(then), parts_of(other), strict=True)
            return all(np.array_equal(now[:, 1], whole[place, 1]) for now, whole in pairs)

        assert [could_be(other) for k, other in enumerate(before) if k != n].count(True) == 1


def test_silent_is_the_prior_and_late_is_one_second_late():
    before = outputs()
    for then in disturb(before, VIEWS, {"door": "silent"}, RATE, 0):
        assert (then.p[:, 0] == 1 / M).all() and (then.facing[:, 0] == 1 / 2).all()
        assert np.isnan(then.unlearned[:, 0]).all() and np.isfinite(then.unlearned[:, 1:]).all()
    delay = round(FAULT_DELAY_S * RATE)
    for own, then in zip(before, disturb(before, VIEWS, {"table": "late"}, RATE, 0), strict=True):
        assert (then.p[:delay, 2] == 1 / M).all() and (then.facing[:delay, 2] == 1 / 2).all()
        assert np.isnan(then.unlearned[:delay, 2]).all()
        for was, now in zip(parts_of(own), parts_of(then), strict=True):
            np.testing.assert_array_equal(now[delay:, 2], was[: max(len(was) - delay, 0), 2])


def test_faults_are_parsed_view_by_view():
    assert parse_fault("door=wrong", VIEWS) == ("door", "wrong")
    assert parse_fault("yaw:45,pitch:10=late", ("yaw:45,pitch:10",)) == ("yaw:45,pitch:10", "late")
    assert parse_fault("a=b=late", ("a=b",)) == ("a=b", "late")


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("door", "VIEW=KIND is expected, VIEW one of door, wheel, table"),
        ("roof=late", "VIEW one of door, wheel, table"),
        ("=late", "VIEW=KIND is expected"),
        ("door=", "unknown fault ''; known: wrong, noise, silent, late"),
        ("door=asleep", "unknown fault 'asleep'"),
    ],
)
def test_bad_faults_are_rejected(text, error):
    with pytest.raises(BadInput, match=error):
        parse_fault(text, VIEWS)
