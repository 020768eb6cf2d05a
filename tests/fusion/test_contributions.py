"""What each judge contributed: the log odds that go with him, and whether the verdict stands without him."""

import math

import numpy as np
import pytest

from common.probability import uniform
from fusion.engine.contributions import contributions
from fusion.engine.pooling import PoolingCase, pool_posteriors
from fusion.engine.roster import AgedPosterior
from fusion.engine.rules import RULES

PRODUCT, DEFAULT = RULES["product"], RULES["robust_inverse_entropy"]


def judge(name, p, state="counted", **more):
    return AgedPosterior(name, np.array(p), 0.1, 0.0, state, **more)


def test_of_independent_judges_it_is_each_ones_own_log_odds():
    said = [judge("a", (0.8, 0.1, 0.1)), judge("b", (0.3, 0.5, 0.2)), judge("c", (0.6, 0.3, 0.1))]
    told = contributions(PRODUCT, said, uniform(3), 1.0, 0)
    assert told["a"].nats == pytest.approx(math.log(8)) and told["b"].nats == pytest.approx(math.log(0.3 / 0.5))
    assert not told["a"].nats < told["c"].nats
    assert [told[name].stands for name in "abc"] == [True, True, True]


def test_it_does_not_stand_without_the_one_who_carried_it():
    said = [judge("a", (0.9, 0.05, 0.05)), judge("b", (0.3, 0.4, 0.3)), judge("c", (0.3, 0.4, 0.3))]
    told = contributions(PRODUCT, said, uniform(3), 1.0, 0)
    assert not told["a"].stands and told["b"].stands and told["b"].nats < 0 < told["a"].nats


def test_who_is_not_heard_contributed_nothing_and_alone_is_all():
    said = [judge("a", (0.9, 0.05, 0.05)), judge("b", uniform(3), "silent")]
    told = contributions(DEFAULT, said, uniform(3), 1.0, 0)
    assert set(told) == {"a"} and not told["a"].stands
    assert contributions(DEFAULT, said[:1], uniform(3), 1.0, 0)["a"].nats == pytest.approx(told["a"].nats)


def test_vetoes_leave_it_finite():
    said = [judge("a", (1.0, 0, 0)), judge("b", (0, 1.0, 0)), judge("c", (0, 1.0, 0))]
    for rule in ("product", "inverse_entropy", "log"):
        told = contributions(RULES[rule], said, uniform(3), 1.0, 1)
        assert all(math.isfinite(c.nats) for c in told.values())


def test_of_an_abstention_it_is_to_what_was_likeliest_also_something_else():
    said = [judge("a", (0.5, 0.3, 0.2), unlearned=0.9), judge("b", (0.4, 0.3, 0.3))]
    assert pool_posteriors(PoolingCase(PRODUCT, said, uniform(3))).answers.argmax() == 3
    told = contributions(PRODUCT, said, uniform(3), 1.0, None)
    assert told["a"].nats > 0 and not told["a"].stands and told["b"].nats < 0 and told["b"].stands
