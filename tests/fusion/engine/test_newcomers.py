"""Newcomers: before verdicts have shown whom to believe, nobody is much surer than the others."""

import numpy as np
import pytest

from fusion.engine.newcomers import LEAST_INFLUENCE, PROVEN, SURER, limit_newcomers, newcomers
from fusion.engine.reliability import information_of
from fusion.engine.roster import AgedPosterior

UNIFORM, WEAK, SURE = (0.25,) * 4, (0.1, 0.7, 0.1, 0.1), (0.01, 0.01, 0.97, 0.01)


def observers(*rows):
    return [AgedPosterior(f"o{n}", np.array(row), 0.1, 0.0, "counted") for n, row in enumerate(rows)]


def limited(posteriors, evidence):
    return limit_newcomers(posteriors, newcomers([one.observer for one in posteriors], evidence))


def influences(posteriors, evidence):
    return [one.influence for one in limited(posteriors, evidence)]


def test_one_that_is_much_surer_than_all_others_counts_less_until_movements_have_shown_that_it_can_be_believed():
    three = observers(WEAK, WEAK, SURE)
    limit = SURER * information_of(WEAK, None) / information_of(SURE, None)
    assert influences(three, {}) == [1.0, 1.0, pytest.approx(limit)]
    assert influences(three, {"o2": PROVEN / 2}) == [1.0, 1.0, pytest.approx((1 + limit) / 2)]
    assert limited(three, {"o2": PROVEN}) is three
    assert influences(three, {"o2": -8.0}) == influences(three, {})


@pytest.mark.parametrize("rows", [(WEAK, SURE), (UNIFORM, WEAK, SURE), (WEAK, SURE, SURE), (SURE, SURE, SURE)])
def test_of_two_either_may_be_right_and_two_that_are_sure_need_no_limit(rows):
    posteriors = observers(*rows)
    assert limited(posteriors, {}) is posteriors


def test_some_influence_is_left_beside_others_that_know_almost_nothing():
    vague = (0.25, 0.26, 0.25, 0.24)
    assert LEAST_INFLUENCE <= min(influences(observers(vague, vague, SURE), {})) < 1.0
