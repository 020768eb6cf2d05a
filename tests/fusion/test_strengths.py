"""The default rule: what certainty, contradiction, likeness and trust do to a judge, and what no single one can do."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.probability import normalise, uniform
from fusion.engine.rules import RULES
from fusion.engine.strengths import CAP, ROBUSTNESS, ObserverTrust, similarity, strengths

RULE = RULES["robust_inverse_entropy"]


def pool(p, prior=None):
    p = np.asarray(p, dtype=float)
    return RULE.pool(p, uniform(p.shape[1]) if prior is None else np.asarray(prior)).p


def found(p, standing=None):
    p = np.asarray(p, dtype=float)
    return strengths(p, uniform(p.shape[1]), standing or ObserverTrust.unknown(len(p)))


def beliefs(judges, least=0.0):
    masses = st.integers(2, 5).flatmap(lambda m: arrays(np.float64, (judges, m), elements=st.floats(least, 1)))
    return masses.map(lambda a: normalise(a + (a.sum(1, keepdims=True) == 0)))


HONEST = np.array([[0.7, 0.1, 0.1, 0.1], [0.6, 0.2, 0.05, 0.15], [0.55, 0.1, 0.2, 0.15]])


def test_two_judges_by_the_formula():
    p, prior = np.array([[0.7, 0.2, 0.1], [0.3, 0.4, 0.3]]), np.array([0.5, 0.25, 0.25])
    told = (p * np.log2(p / prior)).sum(1)
    part = np.minimum(told / 0.05, 1)
    eps = np.interp(part.sum(), (1, 2), ROBUSTNESS[:2])
    safe = (1 - eps) * p + eps * prior
    inverse = 1 / -(safe * np.log2(safe)).sum(1)
    w = np.minimum(inverse / (part @ inverse / part.sum()), CAP)
    said = np.log(0.99 * p / prior + 0.01)
    much = np.abs(said).mean(1)
    rho = np.exp(-np.abs(said[0] - said[1]).mean() / much.mean() / 0.05)
    rho *= min((1 - p.mean(axis=0).max()) / 0.03, 1)
    w = w / (1 + rho * part[::-1])
    w = w / np.sqrt(max(w @ part, 1))
    mass = prior * np.prod((safe / prior) ** w[:, None], axis=0)
    assert pool(p, prior) == pytest.approx(mass / mass.sum())


@given(beliefs(1, 0.01))
def test_one_judge_is_believed_as_he_is(p):
    assert pool(p) == pytest.approx(p[0], abs=0.011)


@given(beliefs(3), st.integers(1, 4))
def test_who_is_at_the_prior_is_neutral_however_many(p, many):
    m = p.shape[1]
    assert pool(np.vstack([p, np.tile(uniform(m), (many, 1))])) == pytest.approx(pool(p), abs=1e-9)


@given(beliefs(3), st.integers(0, 2), st.floats(1e-9, 1e-4))
def test_hardly_leaving_the_prior_hardly_changes_anything(p, label, step):
    m = p.shape[1]
    nearly = (1 - step) * uniform(m) + step * np.eye(m)[label % m]
    assert pool(np.vstack([p, nearly])) == pytest.approx(pool(np.vstack([p, uniform(m)])), abs=5e-3)


@given(beliefs(3, 0.01))
def test_the_same_judge_again_adds_nothing_to_two(p):
    """Two identical judges count as one, up to what it means that somebody confirms the first."""
    exponents = found(np.vstack([p[:2], p[:1]])).exponents
    assert exponents[0] == pytest.approx(exponents[2])
    assert similarity(p / uniform(p.shape[1])).diagonal() == pytest.approx(0)


def test_twins_share_one_voice():
    door, wheel = [0.8, 0.1, 0.05, 0.05], [0.1, 0.7, 0.1, 0.1]
    one = found([door, wheel, [0.4, 0.3, 0.2, 0.1]]).exponents
    two = found([door, door, wheel, [0.4, 0.3, 0.2, 0.1]]).exponents
    assert two[0] + two[1] < 1.35 * one[0]


def test_learned_twins_share_one_voice_though_they_tremble():
    p = np.array([[0.8, 0.1, 0.05, 0.05], [0.6, 0.25, 0.1, 0.05], [0.5, 0.1, 0.3, 0.1]])
    doubles = np.zeros((3, 3))
    doubles[0, 1] = doubles[1, 0] = 1.0
    known = found(p, ObserverTrust(np.ones(3), doubles))
    assert known.exponents[:2].sum() < 0.8 * found(p).exponents[:2].sum()
    assert known.shares[:2].sum() < found(p).shares[:2].sum()


def test_a_liar_among_three_is_contradicted():
    lie = np.array([0.01, 0.01, 0.97, 0.01])
    assert pool(np.vstack([HONEST, lie])).argmax() == 0
    shares = found(np.vstack([HONEST, lie])).shares
    assert shares[3] < 0.1
    assert found(np.vstack([HONEST, HONEST[0] * 0.9 + 0.025])).shares[3] > 0.15


def test_who_is_much_surer_than_all_others_is_not_believed_more_for_it():
    vague = np.array([[0.4, 0.3, 0.15, 0.15], [0.38, 0.3, 0.2, 0.12], [0.42, 0.22, 0.2, 0.16]])
    exponents = found(np.vstack([vague, [0.01, 0.97, 0.01, 0.01]])).exponents
    assert exponents[3] < 0.3 * exponents[:3].min()


def test_the_surer_of_two_weighs_more():
    shares = found([[0.9, 0.05, 0.05], [0.5, 0.3, 0.2]]).shares
    assert shares[0] > 0.6


def test_trust_lowers_a_judge_and_his_word():
    p = np.array([[0.1, 0.8, 0.1], [0.6, 0.2, 0.2], [0.3, 0.4, 0.3]])
    trusted = [found(p, ObserverTrust(np.array([t, 1.0, 1.0]), np.zeros((3, 3)))).shares[0] for t in (1.0, 0.5, 0.1)]
    assert trusted[0] > trusted[1] > trusted[2] > 0


@given(beliefs(4), st.integers(0, 3), st.integers(0, 4))
def test_no_single_judge_moves_the_log_odds_beyond_the_bound(p, who, label):
    """Leaving his own belief or putting the wildest one in its place differs by no more than twice the bound."""
    m = p.shape[1]
    told = found(p)
    evidence = np.log((1 - told.epsilon)[:, None] * p * m + told.epsilon[:, None])
    least = ROBUSTNESS[2] / (ROBUSTNESS[2] + (1 - ROBUSTNESS[2]) * m)
    eps = min(ROBUSTNESS[0], least)
    bound = CAP * np.log((1 - eps + eps / m) / (eps / m))
    assert np.ptp(told.exponents[:, None] * evidence, axis=1).max() <= bound + 1e-9
    assert (told.exponents <= CAP + 1e-9).all() and (told.exponents >= 0).all()


@given(beliefs(4), st.lists(st.floats(0.1, 1), min_size=4, max_size=4), st.floats(0, 1))
def test_with_any_standing_all_is_sound(p, trust, rho):
    told = found(p, ObserverTrust(np.array(trust), np.full((4, 4), rho) * (1 - np.eye(4))))
    assert np.isfinite(told.exponents).all() and told.shares.sum() == pytest.approx(1)
    assert ((told.epsilon > 0) & (told.epsilon < 1)).all()
