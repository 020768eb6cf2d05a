"""Contributions: the log odds that go with each observer, and whether the verdict stands without it."""

import math

import pytest
from engine_stage import aged as posterior

from common.probability import uniform
from fusion.engine.pooling import PoolingCase, pool_posteriors
from fusion.engine.rules import RULES
from fusion.engine.verdicts import contributions


def case(rule, *posteriors):
    return PoolingCase(RULES[rule], posteriors, uniform(3))


def test_of_independent_observers_it_is_the_own_log_odds_of_each():
    votes = posterior("a", (0.8, 0.1, 0.1)), posterior("b", (0.3, 0.5, 0.2)), posterior("c", (0.6, 0.3, 0.1))
    result = contributions(case("product", *votes), 0)
    assert result["a"].nats == pytest.approx(math.log(8)) and result["b"].nats == pytest.approx(math.log(0.3 / 0.5))
    assert result["a"].nats >= result["c"].nats and all(contribution.stands for contribution in result.values())


def test_a_label_falls_without_the_observer_that_carried_it():
    unsure = (0.3, 0.4, 0.3)
    votes = posterior("a", (0.9, 0.05, 0.05)), posterior("b", unsure), posterior("c", unsure)
    result = contributions(case("product", *votes), 0)
    assert not result["a"].stands and result["b"].stands and result["b"].nats < 0 < result["a"].nats


def test_a_silent_observer_contributes_nothing_and_a_single_one_everything():
    one, silent = posterior("a", (0.9, 0.05, 0.05)), posterior("b", uniform(3), "silent")
    result = contributions(case("guarded_product", one, silent), 0)
    assert set(result) == {"a"} and not result["a"].stands
    assert contributions(case("guarded_product", one), 0)["a"].nats == pytest.approx(result["a"].nats)


@pytest.mark.parametrize("rule", ["product", "inverse_entropy", "log"])
def test_vetoes_leave_it_finite(rule):
    votes = posterior("a", (1.0, 0, 0)), posterior("b", (0, 1.0, 0)), posterior("c", (0, 1.0, 0))
    assert all(math.isfinite(contribution.nats) for contribution in contributions(case(rule, *votes), 1).values())


def test_of_an_abstention_it_is_to_the_likeliest_answer_also_to_something_else():
    votes = posterior("a", (0.5, 0.3, 0.2), unlearned=0.9), posterior("b", (0.4, 0.3, 0.3))
    assert pool_posteriors(case("product", *votes)).answers.argmax() == 3
    result = contributions(case("product", *votes), None)
    assert result["a"].nats > 0 and not result["a"].stands and result["b"].nats < 0 and result["b"].stands
    # Without the only observer that publishes it, something else is as likely as any movement: 1/4.
    answers = pool_posteriors(case("product", *votes)).answers
    assert result["a"].nats == pytest.approx(math.log(answers[3] / answers[:3].max()) - math.log(0.25 / 0.3))
