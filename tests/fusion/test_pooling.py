"""Pooling with "something else", facing and facets: what nobody says changes nothing."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.probability import normalise, uniform
from fusion.engine.pooling import (
    JointPool,
    PoolingCase,
    facing_deg,
    observer_trust,
    pool_facets,
    pool_joint,
    pool_many,
    pool_posteriors,
)
from fusion.engine.roster import AgedPosterior
from fusion.engine.rules import RULES, Rule, RuleResult, get_rule

ALL = [rule for rule in RULES.values() if rule.most_observers is None]
ids = [rule.name for rule in ALL]
DEFAULT = RULES["robust_inverse_entropy"]
LINEAR = [RULES[name] for name in ("inverse_entropy", "iest", "ieat", "min_entropy", "linear")]
P = [(0.7, 0.2, 0.1), (0.2, 0.5, 0.3), (0.5, 0.3, 0.2)]


def pooled_from(rule, posteriors, prior, temperature=1.0):
    return pool_posteriors(PoolingCase(rule, posteriors, prior, temperature))


def judge(n, p, state="counted", **more):
    return AgedPosterior(f"cam{n}", np.array(p), 0.1, 0.0, state, **more)


def judges(*more):
    return [judge(n, p, **said) for n, (p, said) in enumerate(itertools.zip_longest(P, more, fillvalue={}))]


def surprise(*facing):
    """The same P(facing | movement) for each of three movements."""
    return np.tile(np.minimum(np.rint(-8 * np.log(facing)), 255).astype(int), (3, 1))


def told(mass):
    return np.minimum(np.rint(-8 * np.log(normalise(mass))), 255).astype(int)


@pytest.mark.parametrize("rule", ALL, ids=ids)
def test_while_nobody_says_more_it_is_the_rule_alone_bit_for_bit(rule):
    pooled = pooled_from(rule, judges(), uniform(3))
    plain = rule.pool(np.array(P), uniform(3))
    assert (pooled.p == plain.p).all() and (pooled.weights == plain.weights).all()
    assert pooled.unlearned is None and pooled.facing is None and pooled.answers is pooled.p


# "Something else"


@pytest.mark.parametrize("rule", ALL, ids=ids)
def test_something_else_is_one_more_answer(rule):
    pooled = pooled_from(rule, judges({"unlearned": 0.9}, {"unlearned": 0.8}, {"unlearned": 0.7}), uniform(3))
    assert pooled.unlearned > 0.6 and pooled.p.sum() == pytest.approx(1) and pooled.answers.sum() == pytest.approx(1)


def test_who_does_not_say_it_is_neutral_there():
    prior_there = pooled_from(DEFAULT, judges({"unlearned": 0.6}, {"unlearned": 0.25}), uniform(3))
    silent_there = pooled_from(DEFAULT, judges({"unlearned": 0.6}), uniform(3))
    assert silent_there.unlearned == pytest.approx(prior_there.unlearned)


def test_all_certain_of_something_else_is_no_division_by_zero():
    pooled = pooled_from(RULES["product"], judges({"unlearned": 1.0}, {"unlearned": 1.0}), uniform(3))
    assert np.isfinite(pooled.p).all() and pooled.unlearned == pytest.approx(1)


# Facing


@pytest.mark.parametrize("rule", LINEAR, ids=[rule.name for rule in LINEAR])
def test_linear_rules_are_the_same_after_facing_is_summed_out(rule):
    more = ({"surprise": surprise(0.7, 0.1, 0.1, 0.1)}, {"surprise": surprise(0.1, 0.6, 0.2, 0.1)})
    pooled = pooled_from(rule, judges(*more), uniform(3))
    assert pooled.p == pytest.approx(rule.pool(np.array(P), uniform(3)).p)


@pytest.mark.parametrize("rule", ALL, ids=ids)
def test_weights_are_those_of_the_movements(rule):
    pooled = pooled_from(rule, judges({"surprise": surprise(0.97, 0.01, 0.01, 0.01)}), uniform(3))
    assert pooled.weights == pytest.approx(rule.pool(np.array(P), uniform(3)).weights)
    assert pooled.facing.shape == (4,) and pooled.facing.sum() == pytest.approx(1)


def test_facing_that_says_nothing_is_neutral():
    even = {"surprise": surprise(0.25, 0.25, 0.25, 0.25)}
    assert pooled_from(DEFAULT, judges(even, even), uniform(3)).p == pytest.approx(
        pooled_from(DEFAULT, judges(), uniform(3)).p
    )


def test_two_who_can_only_both_be_right_one_way_round():
    """One sees a bow if he faces left or a lunge if right; another that he faces right: it was a lunge."""
    undecided, left_or_right = (0.49, 0.49, 0.02), [[0.98, 0.02], [0.02, 0.98], [0.5, 0.5]]
    first = judge(0, undecided, surprise=told(np.array(left_or_right)))
    other = judge(1, (0.35, 0.35, 0.3), surprise=told(np.tile([0.05, 0.95], (3, 1))))
    pooled = pooled_from(RULES["product"], [first, other], uniform(3))
    joint = np.array(left_or_right) * np.array(undecided)[:, None] * [0.05, 0.95] * np.array([[0.35], [0.35], [0.3]])
    assert pooled.p == pytest.approx(joint.sum(1) / joint.sum(), abs=0.02) and pooled.p.argmax() == 1
    assert pooled.facing == pytest.approx(joint.sum(0) / joint.sum(), abs=0.03)
    robust = pooled_from(DEFAULT, [first, other], uniform(3))
    assert robust.p.argmax() == 1 and robust.p[1] > 0.6


def test_of_different_numbers_of_directions_the_commonest_counts():
    three = surprise(0.8, 0.1, 0.1)
    more = ({"surprise": three}, {"surprise": surprise(0.1, 0.9)}, {"surprise": three})
    without = ({"surprise": three}, {}, {"surprise": three})
    pooled = pooled_from(DEFAULT, judges(*more), uniform(3))
    assert pooled.facing == pytest.approx(pooled_from(DEFAULT, judges(*without), uniform(3)).facing)


def test_one_liar_about_facing_is_bounded():
    truth, lie = {"surprise": surprise(0.9, 0.05, 0.05)}, {"surprise": surprise(1e-9, 1e-9, 1)}
    said = [*judges(truth, truth, truth), judge(3, P[0], **lie)]
    pooled = pooled_from(DEFAULT, said, uniform(3))
    assert pooled.facing.argmax() == 0
    alone = pooled_from(DEFAULT, [*judges(), judge(3, P[0], **lie)], uniform(3))
    assert np.log(alone.facing[2] / alone.facing[0]) < np.log(1 + 3 / 0.05)


@given(
    st.integers(1, 4),
    arrays(np.float64, (4, 3), elements=st.sampled_from([0.0, 0.1, 1.0])),
    arrays(np.int64, (4, 3, 5), elements=st.integers(0, 255)),
    st.lists(st.sampled_from([None, 0.0, 0.3, 1.0]), min_size=4, max_size=4),
    st.sampled_from(ALL),
    st.sampled_from([0.5, 1.0, 3.0]),
)
def test_whatever_they_say_it_is_sound(n, masses, tables, unlearned, rule, temperature):
    said = [
        judge(i, normalise(masses[i]), unlearned=unlearned[i], surprise=tables[i, :, : 2 + i // 2]) for i in range(n)
    ]
    pooled = pooled_from(rule, said, uniform(3), temperature)
    for p in (pooled.p, pooled.facing, pooled.weights, pooled.answers):
        assert np.isfinite(p).all() and (p >= 0).all() and p.sum() == pytest.approx(1)


def test_a_rule_of_ones_own_pools_facing_too():
    rule = Rule("mean", lambda p, prior: RuleResult(p.mean(axis=0), uniform(len(p))))
    pooled = pooled_from(rule, judges({"surprise": surprise(0.7, 0.2, 0.1)}, {"unlearned": 0.5}), uniform(3))
    assert pooled.facing.sum() == pytest.approx(1) and pooled.unlearned is not None


def test_the_joint_alone():
    cells = np.full((2, 3, 4), 1 / 12)
    found = pool_joint(DEFAULT, cells, uniform(3))
    assert isinstance(found, JointPool) and found.cells == pytest.approx(1 / 12)


def test_the_temperature_is_of_the_answers_and_not_of_the_facing():
    more = ({"surprise": surprise(0.7, 0.2, 0.1)}, {"surprise": surprise(0.7, 0.2, 0.1)})
    cold, warm = (pooled_from(DEFAULT, judges(*more), uniform(3), t) for t in (1.0, 2.0))
    assert warm.p == pytest.approx(np.sqrt(cold.p) / np.sqrt(cold.p).sum())
    assert warm.facing == pytest.approx(cold.facing, abs=0.02)


@pytest.mark.parametrize(("facing", "degrees"), [
    ([0.9, 0.05, 0, 0.05], 0), ([0, 1, 0, 0], 90), ([0.5, 0, 0, 0.5], 315), ([0.1, 0, 0, 0, 0, 0, 0.45, 0.45], 294.3),
    ([1.0], 0), ([0.2, 0.8], 180),
])  # fmt: skip
def test_degrees_are_between_the_likeliest_and_its_neighbours(facing, degrees):
    assert (facing_deg(np.array(facing)) - degrees + 180) % 360 == pytest.approx(180, abs=4)


# Facets


def test_facets_are_pooled_by_the_rule_over_those_who_say_them():
    sudden, strong = np.array([0.2, 0.8]), np.array([0.4, 0.6])
    said = judges({"facets": {"effort_time": sudden}}, {}, {"facets": {"effort_time": strong, "own": np.array([1.0])}})
    pooled = pool_facets(DEFAULT, said)
    assert set(pooled) == {"effort_time"}
    assert pooled["effort_time"] == pytest.approx(DEFAULT.pool(np.array([sudden, strong]), uniform(2)).p)


def test_a_facet_of_another_length_than_most_say_is_left_out_and_facing_is_none():
    two, three = np.array([0.2, 0.8]), np.array([0.2, 0.3, 0.5])
    said = judges(*({"facets": {"own": p, "facing": two}} for p in (two, three, two)))
    assert set(pool_facets(DEFAULT, said)) == {"own"} and len(pool_facets(DEFAULT, said)["own"]) == 2


def test_many_invented_facets_cost_no_more():
    said = judges({"facets": {f"f{n}": np.array([0.5, 0.5]) for n in range(500)}})
    assert len(pool_facets(DEFAULT, said)) == 32


def test_what_was_learned_of_the_judges_comes_with_their_opinions():
    said = judges({"reliability": 0.2, "correlations": {"cam1": 0.7, "cam9": 1.0}}, {"correlations": {"cam0": 0.7}})
    standing = observer_trust(said)
    assert standing.trust.tolist() == [0.2, 1.0, 1.0] and standing.correlations[0].tolist() == [0, 0.7, 0]
    assert pooled_from(DEFAULT, said, uniform(3)).weights[0] < pooled_from(DEFAULT, judges(), uniform(3)).weights[0]


@st.composite
def cases(draw):
    """Scenes of several sizes; in some somebody says something else, in some which way the person faces."""
    names = ["robust_inverse_entropy", "inverse_entropy", "median"]
    m, n = draw(st.integers(2, 5)), draw(st.integers(1, 4))
    opinions = []
    for judge in range(n):
        mass = np.array(draw(st.lists(st.floats(0.001, 1), min_size=m, max_size=m)))
        unlearned = draw(st.none() | st.floats(0, 1))
        surprise = np.full((m, 3), 9) if draw(st.booleans()) and draw(st.booleans()) else None
        doubles = {"1": 0.5} if judge == 0 and n > 1 and draw(st.booleans()) else {}
        trust = draw(st.sampled_from([1.0, 0.4]))
        said = AgedPosterior(
            str(judge), mass / mass.sum(), 0.1, 0.0, "counted", None, unlearned, surprise, {}, trust, doubles
        )
        opinions.append(said)
    return PoolingCase(get_rule(draw(st.sampled_from(names))), opinions, uniform(m), draw(st.sampled_from([1.0, 1.5])))


@given(st.lists(cases(), max_size=6))
def test_many_scenes_at_once_are_pooled_as_each_alone(scenes):
    for case, together in zip(scenes, pool_many(scenes), strict=True):
        alone = pool_posteriors(case)
        assert together.p == pytest.approx(alone.p, abs=1e-12)
        assert together.weights == pytest.approx(alone.weights, abs=1e-12)
        assert together.unlearned == pytest.approx(alone.unlearned, abs=1e-12)
        assert (together.facing is None) == (alone.facing is None)
