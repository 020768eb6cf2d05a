"""The default rule against a brute-force oracle, and what no single observer can do to it."""

import numpy as np
import pytest
from engine_stage import posteriors
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from plain_guarded_product import plain_weights

from common.probability import normalise, uniform
from fusion.engine.guarded_product import BETA, EPSILON, FAULT_PROBABILITY, GAMMA, guarded_weights
from fusion.engine.rules import RULES

RULE = RULES["guarded_product"]
HONEST = np.array([[0.7, 0.1, 0.1, 0.1], [0.6, 0.2, 0.05, 0.15], [0.55, 0.1, 0.2, 0.15], [0.5, 0.15, 0.15, 0.2]])
LIAR = np.array([0.01, 0.01, 0.97, 0.01])


def pool(p, prior=None, trust=None):
    """The pooled posterior, by the fast form, which is compared with the plain one."""
    p = np.asarray(p, dtype=float)
    prior = uniform(p.shape[1]) if prior is None else np.asarray(prior)
    plain, fast = plain_weights(p, prior, trust), RULE.pool_movements(p, prior, trust)
    # The sums of many observers that contradict one another are long, and round off more.
    round_off = 1e-12 * max(len(p) / 4, 1)
    assert np.abs(fast.p - RULE.mix(p[:, :, None], prior, plain)[:, 0]).max() < round_off
    weights = RULE.weigh(p, prior, trust)
    # Shares of observers that all say next to nothing are mostly round-off.
    assert np.abs(fast.weights - plain.shares).max() < 1e-9
    # The exponent of an observer at the prior has no effect, and is mere round-off.
    evidence = np.log((1 - EPSILON) * p / prior + EPSILON)
    for one, other in zip(weights.exponents, plain.exponents, strict=True):
        assert np.abs((one - other)[:, None] * evidence).max() < round_off
    assert np.abs(weights.hypotheses - plain.hypotheses).max() < round_off
    return fast.p


def weighed(p, trust=None):
    p = np.asarray(p, dtype=float)
    return guarded_weights(p, uniform(p.shape[1]), trust)


def product(p):
    """Bayes' product of the posteriors with eps, without any guard."""
    return RULES["product"].pool((1 - EPSILON) * np.asarray(p) + EPSILON / np.shape(p)[1], uniform(np.shape(p)[1])).p


def oracle(p, prior, trust, rho):
    """P(m) of N >= 3 participating observers, hypothesis by hypothesis, in plain loops."""
    observers, labels = p.shape
    divergence = (p * np.log2((1 - EPSILON) * p / prior + EPSILON)).sum(1)
    fault = FAULT_PROBABILITY[min(observers - 3, 1)]
    mass, answers = [], []
    for wrong in (None, *range(observers)):
        believed = [i for i in range(observers) if i != wrong]
        w = {i: trust[i] / (1 + sum(rho[j][i] for j in believed if j != i)) for i in believed}
        ratio = [
            np.prod([((1 - EPSILON) * p[i, m] / prior[m] + EPSILON) ** w[i] for i in believed]) for m in range(labels)
        ]
        z = sum(prior[m] * ratio[m] for m in range(labels))
        # Honest with .9 t: the odds of a fault, beside those of full trust.
        doubted = 1.0 if wrong is None else fault / (1 - fault) * (1 / (0.9 * trust[wrong]) - 1) / (1 / 0.9 - 1)
        mass.append(doubted * z**BETA)
        bits = np.array([w[i] * divergence[i] ** power for power in (1, 2) for i in believed]).reshape(2, -1).sum(1)
        number = (0.05**2 + bits[0] ** 2) / (0.05**2 + bits[1])
        tempered = np.array([prior[m] * ratio[m] ** (max(number, 1) ** (GAMMA - 1)) for m in range(labels)])
        answers.append(tempered / tempered.sum())
    return sum(share * answer for share, answer in zip(np.array(mass) / sum(mass), answers, strict=True))


@given(st.integers(3, 5), st.integers(3, 6), st.integers(0, 10_000))
def test_it_is_the_average_over_which_observer_is_wrong(observers, labels, seed):
    rng = np.random.default_rng(seed)
    prior = normalise(rng.uniform(0.5, 1.5, labels))
    # Different enough to be uncorrelated without learning, and none near the prior.
    p = normalise(rng.dirichlet(np.full(labels, 0.4), observers) + 0.01)
    divergence = (p * np.log2((1 - EPSILON) * p / prior + EPSILON)).sum(1)
    rho = np.zeros((observers, observers))
    trust = rng.uniform(0.1, 1, observers)
    if (divergence > 0.06).all():
        logs = np.log((1 - EPSILON) * p / prior + EPSILON)
        sizes = np.abs(logs).sum(1)
        for i in range(observers):
            for j in range(i):
                distance = np.abs(logs[i] - logs[j]).sum() / ((sizes[i] + sizes[j]) / 2)
                unsure = min((1 - (p[i] + p[j]).max() / 2) / 0.03, 1)
                rho[i, j] = rho[j, i] = np.exp(-distance / 0.05) * unsure
        assert pool(p, prior, trust) == pytest.approx(oracle(p, prior, trust, rho))


ROWS = st.sampled_from([
    [1.0, 0.0, 0.0, 0.0], [0.0, 1.0000000000000002, -0.0, 0.0], [0.25] * 4, [0.25 + 1e-10, 0.25 - 1e-10, 0.25, 0.25],
    [1 - 3e-16, 1e-16, 1e-16, 1e-16], [0.97, 0.01, 0.01, 0.01], [0.4, 0.3, 0.2, 0.1], [0.4, 0.3, 0.1, 0.2],
    [5e-324, 0.0, 0.0, 1.0],
])  # fmt: skip
ROWS |= arrays(np.float64, 4, elements=st.floats(0, 1)).map(normalise).map(list)
TRUSTS = st.none() | st.sampled_from([0.1, 0.5, 1.0])


@given(st.lists(ROWS, min_size=1, max_size=6), st.sampled_from([1, 16]), TRUSTS, st.integers(0, 3))
def test_the_fast_form_gives_what_the_plain_one_gives(rows, copies, known, skew):
    """Also for certainties, round-off, observers at the prior and next to it, one observer and many."""
    p = np.array(rows * copies)
    prior = normalise(uniform(4) + 0.1 * skew * np.arange(4))
    trust = None if known is None else np.linspace(known, 1, len(p))
    assert pool(p, prior, trust).sum() == pytest.approx(1)


@given(posteriors(2, 0.01))
def test_one_and_two_are_the_tempered_product(p):
    assert pool(p[:1]) == pytest.approx((1 - EPSILON) * p[0] + EPSILON / p.shape[1])
    both = (1 - EPSILON) * p + EPSILON / p.shape[1]
    exponents = weighed(p).exponents[0]
    assert exponents[0] == pytest.approx(exponents[1])
    assert pool(p) == pytest.approx(normalise(np.prod(both ** exponents[:, None], axis=0)))


def test_honest_observers_decide_as_their_product_does():
    rng = np.random.default_rng(0)
    agree = 0
    for _ in range(400):
        truth = rng.integers(8)
        evidence = rng.normal(0, 1, (4, 8)) + 2.0 * (np.arange(8) == truth)
        p = normalise(np.exp(evidence))
        agree += pool(p).argmax() == product(p).argmax()
    assert agree >= 0.985 * 400


def test_a_sure_observer_among_unsure_ones_is_followed_and_not_suspected():
    unsure = np.array([[0.3, 0.25, 0.25, 0.2], [0.28, 0.3, 0.22, 0.2], [0.26, 0.24, 0.26, 0.24]])
    assert pool(np.vstack([unsure, [0.03, 0.91, 0.03, 0.03]]))[1] > 0.75


@pytest.mark.parametrize("honest", [2, 3, 4])
def test_one_that_contradicts_the_others_is_left_out(honest):
    result = weighed(np.vstack([HONEST[:honest], LIAR]))
    assert pool(np.vstack([HONEST[:honest], LIAR])).argmax() == 0
    assert result.hypotheses.argmax() == honest + 1
    agreeing = weighed(np.vstack([HONEST[:honest], [0.97, 0.01, 0.01, 0.01]]))
    assert result.shares[-1] < 0.5 * agreeing.shares[-1]


@given(posteriors(1), st.integers(2, 6))
def test_any_liar_beside_many_that_agree_changes_no_label(liar, extra):
    honest = normalise(
        np.eye(liar.shape[1])[0] * 3 + np.random.default_rng(extra).uniform(0.2, 0.9, (3, liar.shape[1]))
    )
    assert pool(np.vstack([honest, liar])).argmax() == 0


@given(posteriors(4))
def test_one_veto_is_bounded(p):
    """Whatever observer 3 says, within each hypothesis it moves log odds by at most ln(1 + M (1-eps)/eps)."""
    m = p.shape[1]
    result = weighed(p)
    evidence = np.log((1 - result.epsilon)[:, None] * p * m + result.epsilon[:, None])
    moved = np.ptp(result.exponents[:, 3:] * evidence[3], axis=-1)
    assert moved.max() <= np.log(1 + m * (1 - EPSILON) / EPSILON) + 1e-9
    assert result.hypotheses.sum() == pytest.approx(1) and (result.hypotheses >= 0).all()


@given(posteriors(3), st.integers(1, 4), st.integers(0, 2), st.floats(1e-9, 1e-4))
def test_any_number_at_the_prior_change_nothing_and_one_near_it_hardly(p, many, label, step):
    m = p.shape[1]
    assert pool(np.vstack([p, np.tile(uniform(m), (many, 1))])) == pytest.approx(pool(p), abs=1e-9)
    nearly = (1 - step) * uniform(m) + step * np.eye(m)[label % m]
    assert pool(np.vstack([p, nearly])) == pytest.approx(pool(p), abs=5e-3)


@given(posteriors(1, 0.05), st.integers(2, 6))
def test_copies_of_one_posterior_count_as_one(p, copies):
    assert pool(np.repeat(p, copies, axis=0)) == pytest.approx(pool(p), abs=1e-6)


def test_a_pair_that_sees_the_same_does_not_outvote_one_that_sees_more():
    """Cameras side by side, or opposite each other: the same posterior twice, against a surer one."""
    pair, other = [0.5, 0.3, 0.1, 0.1], [0.1, 0.8, 0.05, 0.05]
    assert pool([pair, pair, other]) == pytest.approx(pool([pair, other]), abs=0.06)
    assert pool([pair, pair, other]).argmax() == 1


@given(posteriors(2, 0.02), st.integers(0, 4), st.floats(1.1, 5))
def test_one_observer_is_monotone_and_two_nearly(p, label, factor):
    """Raising a posterior in a label, the other labels in proportion, raises it in the result, or hardly lowers it."""
    label %= p.shape[1]
    raised = p.copy()
    raised[0, label] *= factor
    raised = normalise(raised)
    assert pool(raised[:1])[label] >= pool(p[:1])[label] - 1e-9
    assert pool(raised)[label] >= pool(p)[label] - 0.05


def test_of_three_an_absurd_claim_counts_less_than_a_moderate_one():
    """The influence of a contradiction falls again when it becomes large, so the rule is not monotone."""
    claims = [[(1 - q) / 3, q, (1 - q) / 3, (1 - q) / 3] for q in (0.25, 0.6, 0.999)]
    little, moderate, absurd = (pool(np.vstack([HONEST[:3], claim]))[1] for claim in claims)
    assert little < moderate and absurd < moderate + 0.02


def test_a_weak_observer_that_agrees_hardly_lowers_the_certainty():
    sure = np.array([0.85, 0.05, 0.05, 0.05])
    for top in (0.26, 0.28, 0.3, 0.4, 0.6):
        weak = [top, (1 - top) / 2, (1 - top) / 4, (1 - top) / 4]
        assert pool([sure, weak])[0] > pool([sure])[0] - 0.02


@pytest.mark.parametrize("observers", [*range(1, 8), 20])
def test_many_scenes_are_pooled_to_the_same_bits_as_each_alone(observers):
    rng = np.random.default_rng(observers)
    p, prior = rng.dirichlet(np.full(20, 0.3), (50, observers)), uniform(20)
    many = RULE.pool_movements(p, prior, None)
    alone = [RULE.pool_movements(scene, prior, None) for scene in p]
    assert np.array_equal(many.p, [scene.p for scene in alone])
    assert np.array_equal(many.weights, [scene.weights for scene in alone])
