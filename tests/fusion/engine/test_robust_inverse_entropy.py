"""robust_inverse_entropy: certainty, contradiction, correlation and trust, and what no single observer can do."""

import numpy as np
import pytest
from engine_stage import posteriors
from hypothesis import given
from hypothesis import strategies as st

from common.probability import normalise, uniform
from fusion.engine.robust_inverse_entropy import CAP, ROBUSTNESS, robust_weights
from fusion.engine.rules import RULES
from fusion.engine.weighing import ObserverTrust, similarity

RULE = RULES["robust_inverse_entropy"]


def pool(p, prior=None):
    p = np.asarray(p, dtype=float)
    return RULE.pool(p, uniform(p.shape[1]) if prior is None else np.asarray(prior)).p


def weighed(p, trust=None):
    p = np.asarray(p, dtype=float)
    return robust_weights(p, uniform(p.shape[1]), trust or ObserverTrust.unknown(len(p)))


HONEST = np.array([[0.7, 0.1, 0.1, 0.1], [0.6, 0.2, 0.05, 0.15], [0.55, 0.1, 0.2, 0.15]])


def test_two_observers_by_the_formula():
    p, prior = np.array([[0.7, 0.2, 0.1], [0.3, 0.4, 0.3]]), np.array([0.5, 0.25, 0.25])
    part = np.minimum((p * np.log2(p / prior)).sum(1) / 0.05, 1)
    eps = np.interp(part.sum(), (1, 2), ROBUSTNESS[:2])
    robust = (1 - eps) * p + eps * prior
    inverse = 1 / -(robust * np.log2(robust)).sum(1)
    w = np.minimum(inverse / (part @ inverse / part.sum()), CAP)
    logs = np.log(0.99 * p / prior + 0.01)
    rho = np.exp(-np.abs(logs[0] - logs[1]).mean() / np.abs(logs).mean(1).mean() / 0.05)
    rho *= min((1 - p.mean(axis=0).max()) / 0.03, 1)
    w = w / (1 + rho * part[::-1])
    w = w / np.sqrt(max(w @ part, 1))
    mass = prior * np.prod((robust / prior) ** w[:, None], axis=0)
    assert pool(p, prior) == pytest.approx(mass / mass.sum())


def clip(value):
    return min(max(value, 0.0), 1.0)


def oracle(p, prior, trust, learned):
    """Exponents and eps of N observers, in plain loops by rules 1 to 7."""
    size = len(p)
    others = [[j for j in range(size) if j != i] for i in range(size)]
    bits = [float((row * np.log2(row / prior)).sum()) for row in p]
    part = [min(b / 0.05, 1.0) for b in bits]
    two, three = clip(sum(part) - 1), clip(sum(part) - 2)
    eps = 0.01 + 0.04 * two + 0.15 * three
    robust = [(1 - eps) * row + eps * prior for row in p]
    inverse = [1 / max(float(-(row * np.log2(row)).sum()), 0.01) for row in robust]
    mean = sum(a * i for a, i in zip(part, inverse, strict=True)) / sum(part)
    surer = [min(1.2 * max(bits[j] for j in others[i]) / bits[i], 1.0) ** three for i in range(size)]
    assert size < 8 or max(inverse) > 2 * mean
    w = [min(inverse[i] / mean, 2.0) * trust[i] * surer[i] for i in range(size)]
    similar = similarity(p / prior)
    unsure = [[min((1 - (p[i] + p[j]).max() / 2) / 0.03, 1) for j in range(size)] for i in range(size)]
    several = sum(part) > 1
    rho = [
        [several * max(similar[i, j] * unsure[i][j], learned[i, j]) * part[j] for j in range(size)] for i in range(size)
    ]
    factor, agreement = [1.0] * size, [1.0] * size
    for _ in range(2):
        factor = []
        for i in range(size):
            q = prior.copy()
            for j in others[i]:
                shared = sum(rho[j][k] * agreement[k] for k in others[i] if k != j)
                q *= (0.8 * p[j] / prior + 0.2) ** (w[j] * agreement[j] / (1 + shared))
            factor.append(float((q / q.sum() * p[i] / prior).sum()))
        agreement = [min(o, 1.0) ** 2 for o in factor]
    agreement = [min(o, 1.0) ** (2 * three) for o in factor]
    w = [w[i] * agreement[i] / (1 + sum(rho[i][j] * agreement[j] for j in others[i])) for i in range(size)]
    total = max(sum(a * b for a, b in zip(w, part, strict=True)), 1.0)
    return [x * total**-0.5 for x in w], [eps / (eps + (1 - eps) * o**three) for o in factor]


@pytest.mark.parametrize(
    ("observers", "labels", "step"), [(2, 4, 1.0), (3, 4, 1.0), (4, 4, 1.0), (8, 20, 0.35), (2, 4, 0.1)]
)
def test_exponents_and_eps_are_those_of_the_rules(observers, labels, step):
    """step: from the prior, so that one of eight is surer than twice the mean, or two hardly participate."""
    rng = np.random.default_rng(observers)
    for _ in range(10):
        prior = normalise(rng.uniform(0.5, 1.5, labels))
        p = normalise(rng.dirichlet(np.full(labels, 0.5), observers) + 0.01)
        p[: observers - (labels > 4)] = step * p[: observers - (labels > 4)] + (1 - step) * prior
        # One that is hardly surer than the prior, and one that is much surer than all.
        p[0] = normalise(prior + rng.uniform(0, 0.1, labels))
        p[-1] = normalise(p[-1] ** (3 if step == 1.0 else 1) if labels == 4 else np.eye(labels)[0] + 1e-6)
        trust, learned = rng.uniform(0.1, 1, observers), np.triu(rng.uniform(0, 1, (observers, observers)), 1)
        learned += learned.T
        result = robust_weights(p, prior, ObserverTrust(trust, learned))
        exponents, epsilon = oracle(p, prior, trust, learned)
        assert result.exponents == pytest.approx(exponents) and result.epsilon == pytest.approx(epsilon)


@given(posteriors(1, 0.01))
def test_a_single_posterior_stays_as_it_is(p):
    assert pool(p) == pytest.approx(p[0], abs=0.011)


@given(posteriors(3), st.integers(1, 4), st.integers(0, 2), st.floats(1e-9, 1e-4))
def test_any_number_at_the_prior_is_neutral_and_one_near_it_nearly(p, many, label, step):
    m = p.shape[1]
    assert pool(np.vstack([p, np.tile(uniform(m), (many, 1))])) == pytest.approx(pool(p), abs=1e-9)
    nearly = (1 - step) * uniform(m) + step * np.eye(m)[label % m]
    assert pool(np.vstack([p, nearly])) == pytest.approx(pool(np.vstack([p, uniform(m)])), abs=5e-3)


@given(posteriors(3, 0.01))
def test_identical_posteriors_have_the_same_exponent_and_none_is_similar_to_itself(p):
    exponents = weighed(np.vstack([p[:2], p[:1]])).exponents
    assert exponents[0] == pytest.approx(exponents[2])
    assert similarity(p / uniform(p.shape[1])).diagonal() == pytest.approx(0)


def test_identical_observers_share_one_weight():
    door, wheel, table = [0.8, 0.1, 0.05, 0.05], [0.1, 0.7, 0.1, 0.1], [0.4, 0.3, 0.2, 0.1]
    one, two = weighed([door, wheel, table]).exponents, weighed([door, door, wheel, table]).exponents
    assert two[0] + two[1] < 1.35 * one[0]


def test_one_that_contradicts_three_counts_less():
    wrong = np.array([0.01, 0.01, 0.97, 0.01])
    assert pool(np.vstack([HONEST, wrong])).argmax() == 0
    assert weighed(np.vstack([HONEST, wrong])).shares[3] < 0.1
    assert weighed(np.vstack([HONEST, HONEST[0] * 0.9 + 0.025])).shares[3] > 0.15


def test_one_that_is_much_surer_than_all_others_does_not_count_more_for_it():
    vague = np.array([[0.4, 0.3, 0.15, 0.15], [0.38, 0.3, 0.2, 0.12], [0.42, 0.22, 0.2, 0.16]])
    exponents = weighed(np.vstack([vague, [0.01, 0.97, 0.01, 0.01]])).exponents
    assert exponents[3] < 0.3 * exponents[:3].min()
    assert weighed([[0.9, 0.05, 0.05], [0.5, 0.3, 0.2]]).shares[0] > 0.6  # the surer of two does


@given(posteriors(4))
def test_no_single_observer_moves_the_log_odds_beyond_the_bound(p):
    m, result = p.shape[1], weighed(p)
    evidence = np.log((1 - result.epsilon)[:, None] * p * m + result.epsilon[:, None])
    least = ROBUSTNESS[2] / (ROBUSTNESS[2] + (1 - ROBUSTNESS[2]) * m)
    eps = min(ROBUSTNESS[0], least)
    bound = CAP * np.log((1 - eps + eps / m) / (eps / m))
    assert np.ptp(result.exponents[:, None] * evidence, axis=1).max() <= bound + 1e-9
    assert (result.exponents <= CAP + 1e-9).all() and (result.exponents >= 0).all()
