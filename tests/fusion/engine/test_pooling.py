"""Pooling of movements, "something else", facing and facets."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from engine_stage import aged
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.probability import normalise, uniform
from fusion.engine.guarded_product import guarded_weights
from fusion.engine.pooling import (
    PoolingCase,
    facing_deg,
    newest_capture_ns,
    observer_trust,
    pool_facets,
    pool_joint,
    pool_posteriors,
    pool_steps,
)
from fusion.engine.rules import DEFAULT_RULE, RULES, get_rule
from fusion.engine.weighing import log_mix

ALL = list(RULES.values())
LINEAR = [RULES[name] for name in ("inverse_entropy", "min_entropy", "linear")]
DEFAULT, PRODUCT = RULES[DEFAULT_RULE], RULES["product"]
UNSEEN = (1 / 3, 1 / 3, 1 / 3)
P = [(0.7, 0.2, 0.1), (0.2, 0.5, 0.3), (0.5, 0.3, 0.2)]
each_rule = pytest.mark.parametrize("rule", ALL, ids=lambda rule: rule.name)


def posterior(n, p, **fields):
    return aged(f"cam{n}", p, **fields)


def posteriors(*fields):
    """Those of P, with more fields for the first ones."""
    return [posterior(n, p, **more) for n, (p, more) in enumerate(itertools.zip_longest(P, fields, fillvalue={}))]


def facets_of(votes):
    return pool_facets([PoolingCase(DEFAULT, votes, uniform(3))])[0]


def pooled(rule, votes, temperature=1.0):
    return pool_posteriors(PoolingCase(rule, votes, uniform(3), temperature))


def unlearned_of_new(votes):
    """The pooled "something else" while cam2 has agreed with no verdict."""
    return pool_posteriors(PoolingCase(DEFAULT, votes, uniform(3), proven=lambda name: name != "cam2")).unlearned


def encoded(mass):
    return np.minimum(np.rint(-8 * np.log(normalise(np.array(mass, dtype=float)))), 255).astype(int)


def facing(*p):
    """The same P(facing | movement) for each of three movements."""
    return {"surprise": np.tile(encoded(p), (3, 1))}


@each_rule
def test_with_movements_alone_it_is_the_rule_bit_for_bit(rule):
    result, plain = pooled(rule, posteriors()), rule.pool(np.array(P), uniform(3))
    assert (result.p == plain.p).all() and (result.weights == plain.weights).all()
    assert result.unlearned is None and result.facing is None and result.answers is result.p


# "Something else"


def test_one_that_has_agreed_with_no_verdict_does_not_find_something_else_alone():
    """Two name a movement, and leave some to something else; the third is sure of it, and may be right once proven."""
    named = [posterior(n, (0.9, 0.05, 0.05), unlearned=u) for n, u in enumerate((0.4, 0.3))]
    sure = posterior(2, UNSEEN, unlearned=1.0)
    assert pooled(DEFAULT, [*named, sure]).unlearned > 0.5
    assert unlearned_of_new([*named, sure]) == pytest.approx(pooled(DEFAULT, named).unlearned)
    # Two can only contradict each other, and one that sees nobody is no third.
    for votes in ([named[0], sure], [named[0], posterior(1, UNSEEN), sure]):
        assert unlearned_of_new(votes) == pooled(DEFAULT, votes).unlearned
    assert unlearned_of_new([sure] * 3) > 0.99


@each_rule
def test_something_else_is_one_more_answer(rule):
    result = pooled(rule, posteriors({"unlearned": 0.9}, {"unlearned": 0.8}, {"unlearned": 0.7}))
    assert result.unlearned > 0.6 and result.p.sum() == pytest.approx(1) and result.answers.sum() == pytest.approx(1)


def test_an_observer_that_does_not_publish_it_is_neutral_there():
    at_prior = pooled(DEFAULT, posteriors({"unlearned": 0.6}, {"unlearned": 0.25}))
    assert pooled(DEFAULT, posteriors({"unlearned": 0.6})).unlearned == pytest.approx(at_prior.unlearned)


# Facing


@pytest.mark.parametrize("rule", LINEAR, ids=lambda rule: rule.name)
def test_linear_rules_are_the_same_after_facing_is_summed_out(rule):
    result = pooled(rule, posteriors(facing(0.7, 0.1, 0.1, 0.1), facing(0.1, 0.6, 0.2, 0.1)))
    assert result.p == pytest.approx(rule.pool(np.array(P), uniform(3)).p)


@each_rule
def test_weights_are_those_of_the_movements(rule):
    result = pooled(rule, posteriors(facing(0.97, 0.01, 0.01, 0.01)))
    assert result.weights == pytest.approx(rule.pool(np.array(P), uniform(3)).weights)
    assert result.facing.shape == (4,) and result.facing.sum() == pytest.approx(1)


def test_facing_decides_between_two_movements():
    """One sees a bow if the person faces left or a lunge if right; another that they face right: it was a lunge."""
    p, left_or_right = np.array([0.49, 0.49, 0.02]), np.array([[0.98, 0.02], [0.02, 0.98], [0.5, 0.5]])
    q, right = np.array([0.35, 0.35, 0.3]), [0.05, 0.95]
    votes = [posterior(0, p, surprise=encoded(left_or_right)), posterior(1, q, **facing(*right))]
    joint = left_or_right * p[:, None] * right * q[:, None]
    result = pooled(PRODUCT, votes)
    assert result.p == pytest.approx(joint.sum(1) / joint.sum(), abs=0.02) and result.p.argmax() == 1
    assert result.facing == pytest.approx(joint.sum(0) / joint.sum(), abs=0.03)
    assert pooled(DEFAULT, votes).p[1] > 0.6


def test_of_different_numbers_of_directions_the_most_common_counts():
    three = facing(0.8, 0.1, 0.1)
    result = pooled(DEFAULT, posteriors(three, facing(0.1, 0.9), three))
    assert result.facing == pytest.approx(pooled(DEFAULT, posteriors(three, {}, three)).facing)


def test_one_wrong_facing_is_bounded():
    right, wrong = facing(0.9, 0.05, 0.05), posterior(3, P[0], **facing(1e-9, 1e-9, 1))
    assert pooled(DEFAULT, [*posteriors(right, right, right), wrong]).facing.argmax() == 0
    alone = pooled(DEFAULT, [*posteriors(), wrong]).facing
    assert np.log(alone[2] / alone[0]) < np.log(1 + 3 / 0.05)


def test_cells_that_are_all_alike_stay_so():
    assert pool_joint(DEFAULT, np.full((2, 3, 4), 1 / 12), uniform(3)).p == pytest.approx(1 / 12)


def test_temperature_is_of_the_answers_and_not_of_the_facing():
    votes = posteriors(facing(0.7, 0.2, 0.1), facing(0.7, 0.2, 0.1))
    cold, warm = pooled(DEFAULT, votes), pooled(DEFAULT, votes, 2.0)
    assert warm.p == pytest.approx(np.sqrt(cold.p) / np.sqrt(cold.p).sum())
    assert warm.facing == pytest.approx(cold.facing, abs=0.02)


@given(
    st.integers(1, 4),
    arrays(np.float64, (4, 3), elements=st.sampled_from([0.0, 1e-155, 0.1, 1.0])),
    arrays(np.int64, (4, 3, 5), elements=st.integers(0, 255)),
    st.lists(st.sampled_from([None, 0.0, 0.3, 1.0]), min_size=4, max_size=4),
    st.sampled_from(ALL),
    st.sampled_from([1e-3, 0.5, 1.0, 3.0, 1e3]),
)
# Answers below the smallest normal number, which the temperature raises.
@example(2, np.array([[1.0, 1e-155, 1e-155]] * 4), np.zeros((4, 3, 5), dtype=int), [None] * 4, PRODUCT, 1e3)
# All are certain of something else.
@example(2, np.array([[0.0, 0.0, 1.0]] * 4), np.zeros((4, 3, 5), dtype=int), [1.0] * 4, PRODUCT, 1.0)
def test_any_posteriors_give_distributions(n, masses, tables, unlearned, rule, temperature):
    votes = [
        posterior(i, normalise(masses[i]), unlearned=unlearned[i], surprise=tables[i, :, : 2 + i // 2])
        for i in range(n)
    ]
    result = pooled(rule, votes, temperature)
    for p in (result.p, result.facing, result.weights, result.answers):
        assert np.isfinite(p).all() and (p >= 0).all() and p.sum() == pytest.approx(1)


@pytest.mark.parametrize(("p", "degrees"), [
    ([0.9, 0.05, 0, 0.05], 0), ([0, 1, 0, 0], 90), ([0.5, 0, 0, 0.5], 315), ([0.1, 0, 0, 0, 0, 0, 0.45, 0.45], 294.3),
    ([1.0], 0), ([0.2, 0.8], 180), ([1.0, 0, 0, 1e-18], 0),
])  # fmt: skip
def test_degrees_are_between_the_likeliest_and_its_neighbours(p, degrees):
    assert 0 <= facing_deg(np.array(p)) < 360
    assert (facing_deg(np.array(p)) - degrees + 180) % 360 == pytest.approx(180, abs=4)


# Facets


def test_a_facet_is_pooled_over_the_observers_that_publish_it_with_as_many_values_as_most():
    first, second, odd, one = (np.array(p) for p in ([0.2, 0.8], [0.4, 0.6], [0.2, 0.3, 0.5], [1.0]))
    fields = ({"time": first, "facing": first}, {"time": odd}, {"time": second, "single": one})
    votes = [*posteriors(*({"facets": facets} for facets in fields)), posterior(3, P[0])]
    result = facets_of(votes)
    assert set(result) == {"time"}
    assert result["time"] == pytest.approx(DEFAULT.pool(np.array([first, second]), uniform(2)).p)


def test_of_equally_common_numbers_of_values_the_larger_counts_and_reliability_weighs_facets():
    two, three = np.array([0.2, 0.8]), np.array([0.5, 0.3, 0.2])
    assert len(facets_of(posteriors({"facets": {"time": two}}, {"facets": {"time": three}}))["time"]) == 3
    doubted = {"facets": {"time": two}, "reliability": 0.1}
    result = facets_of(posteriors(doubted, {"facets": {"time": two[::-1]}}))
    assert result["time"][0] > 0.7


@pytest.mark.parametrize("sizes", [(3, 3, 3), (2, 2, 2, 2, 3, 3, 3), (5,)])
@pytest.mark.parametrize("observers", [1, 2, 4, 5, 18])
@pytest.mark.parametrize("reliability", [1.0, 0.3])
def test_facets_that_are_pooled_together_are_those_of_the_plain_formula(sizes, observers, reliability):
    rng = np.random.default_rng(observers)
    facets = [{f"f{n}": rng.dirichlet(np.full(size, 0.3)) for n, size in enumerate(sizes)} for _ in range(observers)]
    if observers > 1:
        # The last observer does not publish the first facet, which is therefore pooled by itself.
        del facets[-1]["f0"]
    votes = [posterior(n, P[0], facets=own) for n, own in enumerate(facets)]
    votes[0] = replace(votes[0], reliability=reliability)
    pooled = facets_of(votes)
    assert list(pooled) == [f"f{n}" for n in range(len(sizes))]
    for name, p in pooled.items():
        publishers = [vote for vote in votes if name in vote.facets]
        rows = np.array([vote.facets[name] for vote in publishers])
        prior = uniform(rows.shape[1])
        weighed = guarded_weights(rows, prior, observer_trust(publishers))
        assert p == pytest.approx(log_mix(rows[:, :, None], prior, weighed)[:, 0], abs=1e-9)


def test_the_newest_capture_is_that_of_an_observer_that_sees_and_not_in_the_future():
    def newest(*ages_s):
        votes = posteriors({}, {"sees": False}, {})
        return newest_capture_ns([replace(v, age_s=s) for v, s in zip(votes, ages_s, strict=True)], 10**9)

    assert newest(0.5, 0.2, None) == 5 * 10**8
    assert newest(-0.5, 0.2, 0.3) == 10**9
    assert newest(None, 0.2, None) is None


def test_invented_facets_are_limited():
    votes = posteriors({"facets": {f"f{n}": np.array([0.5, 0.5]) for n in range(500)}})
    assert len(facets_of(votes)) == 32


def test_trust_comes_with_the_posteriors():
    votes = posteriors({"reliability": 0.2}, {})
    assert observer_trust(votes).tolist() == [0.2, 1.0, 1.0] and observer_trust(posteriors()) is None
    assert pooled(DEFAULT, votes).weights[0] < pooled(DEFAULT, posteriors()).weights[0]


@st.composite
def cases(draw):
    """Scenes of several sizes, some with "something else" or facing."""
    m, n = draw(st.integers(2, 5)), draw(st.integers(1, 4))
    votes = []
    for i in range(n):
        mass = np.array(draw(st.lists(st.floats(0.001, 1), min_size=m, max_size=m)))
        fields = {"unlearned": draw(st.none() | st.floats(0, 1)), "reliability": draw(st.sampled_from([1.0, 0.4]))}
        if draw(st.booleans()) and draw(st.booleans()):
            fields["surprise"] = np.full((m, 3), 9)
        fields["facets"] = {name: normalise(mass[:2] + k) for k, name in enumerate("abc") if draw(st.booleans())}
        votes.append(posterior(i, mass / mass.sum(), **fields))
    rule = get_rule(draw(st.sampled_from(["guarded_product", "inverse_entropy", "log"])))
    proven = draw(st.sampled_from([None, ["cam0", "cam2"].__contains__]))
    return PoolingCase(rule, votes, uniform(m), draw(st.sampled_from([1.0, 1.5])), proven=proven)


@given(st.lists(cases(), max_size=4), st.integers(1, 3))
def test_many_scenes_at_once_are_pooled_to_the_same_bits_as_each_alone(scenes, copies):
    """A service of many scenes pools them together; a replayed capture judges each alone."""
    for case, together in zip(scenes * copies, pool_steps(scenes * copies), strict=True):
        alone = pool_posteriors(case)
        facets = pool_facets([case])[0]
        assert list(facets) == list(together.facets)
        assert [p.tolist() for p in facets.values()] == [p.tolist() for p in together.facets.values()]
        assert together.p.tolist() == alone.p.tolist() and together.weights.tolist() == alone.weights.tolist()
        assert together.unlearned == alone.unlearned
        assert (together.facing is None) == (alone.facing is None)
