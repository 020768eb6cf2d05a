"""P(something else) follows what people left out show, and stays as it is without evidence."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from common.probability import softmax
from observer.model.something_else import (
    AGREEMENT,
    AGREEMENT_OFFSET,
    AGREEMENT_SLOPE,
    OFFSET,
    PRIOR,
    SCALING,
    SLOPE,
    ElseRows,
    add_log_odds,
    agreement_of,
    disagreement,
    learn_agreement,
    learn_confusions,
    learn_scaling,
    log_odds_of,
    scaled,
)

DEFAULTS = {name: parameter.default for name, parameter in SCALING.items()}
NO_AGREEMENT = {name: parameter.default for name, parameter in AGREEMENT.items()}
EARLIER = {name: parameter.earlier for name, parameter in {**SCALING, **AGREEMENT}.items()}
"""What is read from a file of an earlier version."""
ODDS = st.floats(0.001, 0.999)


def rows(slope: float, offset: float, count: int) -> ElseRows:
    """Windows whose log odds are right once they are scaled so."""
    odds = np.random.default_rng(0).normal(0, 1.5, count)
    return ElseRows(odds, 1 / (1 + np.exp(-slope * odds - offset)), np.ones(count))


def test_the_scaling_that_made_the_rows_is_found() -> None:
    learned = learn_scaling([rows(1.6, -0.7, 3000), rows(1.6, -0.7, 3000)], DEFAULTS, ())
    assert learned[SLOPE] == pytest.approx(1.6, abs=0.05)
    assert learned[OFFSET] == pytest.approx(-0.7, abs=0.05)


def test_the_scaling_is_that_of_a_general_minimiser() -> None:
    """Weighted log loss plus PRIOR times the squared distance from the defaults."""
    made, weights = rows(1.6, -0.7, 200), np.random.default_rng(4).uniform(0.2, 3.0, 200)
    start = np.array([DEFAULTS[SLOPE], DEFAULTS[OFFSET]])

    def loss(w: np.ndarray) -> float:
        odds = w[0] * made.log_odds + w[1]
        losses = np.logaddexp(0, odds) - made.targets * odds
        return float((weights * losses).sum() + PRIOR * ((w - start) ** 2).sum())

    best = minimize(loss, start, tol=1e-12).x
    learned = learn_scaling([replace(made, weights=weights)], DEFAULTS, ())
    assert [learned[SLOPE], learned[OFFSET]] == pytest.approx(best, abs=1e-5)


def test_few_rows_change_little() -> None:
    learned = learn_scaling([rows(3.0, -2.0, 10)], DEFAULTS, ())
    assert abs(learned[SLOPE] - 1) < 0.2 and abs(learned[OFFSET]) < 0.3
    assert learn_scaling([], DEFAULTS, ()) == DEFAULTS


def test_what_the_user_has_set_stays() -> None:
    learned = learn_scaling([rows(1.6, -0.7, 3000)], {**DEFAULTS, SLOPE: 1.2}, (SLOPE,))
    assert learned[SLOPE] == 1.2 and learned[OFFSET] < -0.3


def test_a_file_without_the_scaling_judges_as_before() -> None:
    log_answers = np.log([0.5, 0.2, 0.3])
    assert scaled(log_answers, EARLIER) == pytest.approx(0.3)
    assert log_odds_of(log_answers) == pytest.approx(np.log(0.3 / 0.7))
    assert scaled(log_answers, {SLOPE: 2.0, OFFSET: 0.0}) < 0.3 < scaled(log_answers, {SLOPE: 1.0, OFFSET: 1.0})


def members_of(truth, sure, movements=6, seed=0):
    """(N, 3, 2, M) two members: `sure` nats for the right movement, one of noise for each."""
    rng = np.random.default_rng(seed)
    logs = rng.normal(0, 1, (len(truth), 3, 2, movements))
    logs[np.arange(len(truth)), :, :, truth] += sure
    return softmax(logs)


def judged(members, parameters, p=0.2, confusions=None):
    """P(something else) after the members have judged."""
    confusions = np.eye(members.shape[-1]) if confusions is None else confusions
    return add_log_odds(p, disagreement(members, confusions, parameters))


def learned_agreement(count=60, sure=4.0, explicit=(), movements=6):
    truth = np.arange(count) % movements
    return learn_agreement(members_of(truth, sure, movements), truth, np.eye(movements), NO_AGREEMENT, explicit)


def test_agreement_is_the_probability_that_draws_from_both_members_are_the_same():
    members = members_of(np.array([2]), 1.0)[0, 0]
    rng = np.random.default_rng(1)
    first, second = (rng.choice(6, 100_000, p=p / p.sum()) for p in members)
    assert np.exp(agreement_of(members, np.eye(6))) == pytest.approx((first == second).mean(), abs=0.01)


def test_members_that_disagree_raise_something_else_and_those_that_agree_do_not():
    learned = learned_agreement()
    agreeing, disagreeing = np.array([[0.9, 0.05, 0.05]] * 2), np.array([[0.98, 0.01, 0.01], [0.01, 0.98, 0.01]])
    assert judged(agreeing, learned) == 0.2
    assert judged(disagreeing, learned) > 0.6
    often = np.array([[1.0, 0.9, 0.0], [0.9, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert judged(disagreeing, learned, confusions=often) == 0.2, "both say one of two that are often confused"


def test_movements_that_were_not_learned_are_told_from_others_whose_right_answer_is_struck_out():
    learned, truth = learned_agreement(), np.arange(60) % 6
    shown, strange = members_of(truth, 4.0, seed=5), members_of(truth, 0.0, seed=6)
    more = [np.mean([judged(p, learned, 0.1) > 0.2 for p in each[:, 0]]) for each in (shown, strange)]
    assert more[0] < 0.05 and more[1] > 0.3


@given(ODDS, st.integers(0, 1000), st.floats(0, 6))
def test_disagreement_never_lowers_something_else(p, seed, sure):
    members = members_of(np.array([1]), sure, seed=seed)[0, 0]
    parameters = {AGREEMENT_SLOPE: -1.5, AGREEMENT_OFFSET: -2.0}
    after = judged(members, parameters, p)
    assert p <= after <= 1
    nats = disagreement(members, np.eye(6), parameters)
    assert np.log(after / (1 - after)) - np.log(p / (1 - p)) == pytest.approx(nats, abs=1e-6)
    assert judged(members, EARLIER, p) == p, "a file of an earlier version"


@pytest.mark.parametrize(
    "learned",
    [
        pytest.param(learned_agreement(count=12), id="few movements"),
        pytest.param(learned_agreement(movements=2), id="two movements: struck out, one is left to agree on"),
        pytest.param(learned_agreement(explicit=(AGREEMENT_SLOPE,)), id="set by the user"),
    ],
)
def test_without_evidence_agreement_says_nothing(learned):
    assert learned == NO_AGREEMENT


def test_members_that_know_nothing_say_nothing():
    learned = learned_agreement(count=300, sure=0.0)
    for members in members_of(np.arange(50) % 6, 0.0, seed=3)[:, 0]:
        assert judged(members, learned, 0.3) == pytest.approx(0.3, abs=0.02)


def test_movements_that_are_often_confused_are_alike():
    truth = np.arange(60) % 6
    members = members_of(truth, 5.0)
    half = members[truth == 0] / 2
    members[truth == 0] = half + half[..., [1, 0, 2, 3, 4, 5]]
    confusions = learn_confusions(members)
    assert (np.diag(confusions) == 1).all() and (confusions == confusions.T).all()
    assert confusions[0, 1] > 2 * confusions[2:, :2].max()
