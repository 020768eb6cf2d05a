"""P(something else) is scaled by what people left out show, and stays as it is without evidence."""

import numpy as np
import pytest

from observer.model.something_else import OFFSET, SCALING, SLOPE, ElseRows, learn_scaling, log_odds_of, scaled

DEFAULTS = {name: parameter.default for name, parameter in SCALING.items()}


def rows(slope: float, offset: float, count: int) -> ElseRows:
    """Windows whose log odds are right once they are scaled so."""
    odds = np.random.default_rng(0).normal(0, 1.5, count)
    return ElseRows(odds, 1 / (1 + np.exp(-slope * odds - offset)), np.ones(count))


def test_the_scaling_that_made_the_rows_is_found() -> None:
    learned = learn_scaling([rows(1.6, -0.7, 3000), rows(1.6, -0.7, 3000)], DEFAULTS, ())
    assert learned[SLOPE] == pytest.approx(1.6, abs=0.05)
    assert learned[OFFSET] == pytest.approx(-0.7, abs=0.05)


def test_few_rows_change_little() -> None:
    learned = learn_scaling([rows(3.0, -2.0, 10)], DEFAULTS, ())
    assert abs(learned[SLOPE] - 1) < 0.2 and abs(learned[OFFSET]) < 0.3
    assert learn_scaling([], DEFAULTS, ()) == DEFAULTS


def test_what_the_user_has_set_stays() -> None:
    learned = learn_scaling([rows(1.6, -0.7, 3000)], {**DEFAULTS, SLOPE: 1.2}, (SLOPE,))
    assert learned[SLOPE] == 1.2 and learned[OFFSET] < -0.3


def test_a_file_without_the_scaling_judges_as_before() -> None:
    log_answers = np.log([0.5, 0.2, 0.3])
    assert scaled(log_answers, {}) == pytest.approx(0.3)
    assert log_odds_of(log_answers) == pytest.approx(np.log(0.3 / 0.7))
    assert scaled(log_answers, {SLOPE: 2.0, OFFSET: 0.0}) < 0.3 < scaled(log_answers, {SLOPE: 1.0, OFFSET: 1.0})
