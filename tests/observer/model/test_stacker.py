"""The stacker: its formulas number by number, its losses, its prior, and an instant without a member or a movement."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import check_grad, minimize

from observer.model.stacker import (
    CONTEXT,
    EVIDENCE,
    FARTHEST,
    LOWEST,
    MEMBERS,
    MOST_ODDS,
    OTHER_CONTEXT,
    TASK,
    UNLIKE,
    ElseLoss,
    Gaussians,
    Instants,
    LabelLoss,
    Stacker,
    StackerPrior,
    StackerRows,
    fit,
    instant_of,
    shown_by,
    task_of,
)
from observer.model.stacker_prior import PRIOR

J, Q, G, R = len(MEMBERS), len(CONTEXT), len(EVIDENCE), len(OTHER_CONTEXT)
TASK_ONE = task_of(5, 2, 4, 60)
cheap = settings(max_examples=60, deadline=None)


def raw(rng, movements=4, phase=True, segment=True, takes=True):
    """What members say at one instant, as `instant_of` takes it."""
    return {
        "phase": rng.dirichlet(np.ones(movements)) if phase else None,
        "log_trailing": np.log(rng.dirichlet(np.ones(movements + 1))),
        "log_segment": np.log(rng.dirichlet(np.ones(movements), 2)) if segment else None,
        "distances": np.append(rng.uniform(0.2, 8.0, movements - 1), np.inf) if takes else None,
        "extents": rng.uniform(0.02, 2.0, movements),
        "over": bool(rng.random() < 0.5),
        "elapsed": float(rng.uniform(0.05, 4.0)),
    }


def instants_of(rng, count, movements=4):
    """As many instants; where the begin is not known, the trailing windows alone judge."""
    known = [rng.random() < 0.7 for _ in range(count)]
    return Instants.of([instant_of(**raw(rng, movements, k, k, k)) for k in known])


def stacker_of(rng):
    return Stacker(rng.normal(0.3, 0.3, (J, Q)), rng.normal(0, 0.5, (G, R)))


def wide_prior(spread=1.0):
    """Every weight is 0, give or take `spread`."""
    gaussians = (Gaussians(np.zeros((len(TASK), *shape)), np.full(shape, spread)) for shape in ((J, Q), (G, R)))
    return StackerPrior(*gaussians)


@pytest.mark.parametrize("seed", range(6))
def test_the_posterior_is_the_formulas_of_the_docstring_number_by_number(seed):
    rng = np.random.default_rng(seed)
    instant, stacker = instant_of(**raw(rng, 4, seed % 3 != 0, seed % 2 == 0, seed < 4)), stacker_of(rng)
    c = instant.context
    scores = []
    for m in range(4):
        score = 0.0
        for k in range(J):
            weight = 0.0
            for q in range(Q):
                weight += stacker.weights[k, q] * c[q]
            score += weight * instant.members[k, m]
        scores.append(score)
    p = [math.exp(score) / sum(map(math.exp, scores)) for score in scores]
    h = [
        1.0,
        float(instant.odds),
        sum(p[m] * instant.by_movement[0, m] for m in range(4)),
        float(instant.agreement),
        -sum(each * math.log(each) for each in p) / math.log(4),
        sum(p[m] * instant.by_movement[1, m] for m in range(4)),
    ]
    of_else = math.log(sum(map(math.exp, scores)))
    for g in range(G):
        for r in range(R):
            of_else += stacker.other[g, r] * c[r] * h[g]
    total = sum(map(math.exp, [*scores, of_else]))
    judged, something_else = stacker.judge(instant)
    assert something_else == pytest.approx(math.exp(of_else) / total)
    assert judged * (1 - something_else) == pytest.approx([math.exp(score) / total for score in scores])


@pytest.mark.parametrize("known", [True, False], ids=["known", "unknown"])
def test_after_the_end_the_course_counts_as_much_as_the_end_where_the_begin_is_known(known):
    rng = np.random.default_rng(2)
    instant, stacker = instant_of(**raw(rng, 4, known, known, known)), stacker_of(rng)
    p, something_else = stacker.judge(instant)
    course = rng.dirichlet(np.ones(4))
    ended, with_ended = stacker.judge_ended(instant, 7 * course)
    at_end = p**0.8 * np.exp(instant.members[MEMBERS.index("ended")]) ** 0.2
    shares = np.sqrt(course * at_end) if known else p
    assert with_ended == something_else, "whether it is a movement is judged as before"
    assert ended == pytest.approx(shares / shares.sum())


def test_what_is_sure_counts_in_the_course_and_something_else_does_not():
    p = np.array([[0.9, 0.05, 0.05], [1 / 3, 1 / 3, 1 / 3], [0.9, 0.05, 0.05]])
    entropy = -(0.9 * math.log(0.9) + 0.1 * math.log(0.05)) / math.log(3)
    shown = shown_by(p, np.array([0.2, 0.2, 1.0]))
    assert shown[0] == pytest.approx(0.8 * (1 - entropy) * p[0])
    assert shown[1:] == pytest.approx(0.0)


@pytest.mark.parametrize("seed", range(6))
def test_an_instant_is_what_the_members_say_in_logarithms_shares_and_ratios(seed):
    rng = np.random.default_rng(seed)
    shown = raw(rng)
    instant = instant_of(**shown)
    trailing = np.exp(shown["log_trailing"])
    members = [shown["phase"], trailing[:-1] / trailing[:-1].sum(), *np.exp(shown["log_segment"])]
    for k, p in enumerate(members):
        assert instant.members[k] == pytest.approx(np.maximum(np.log(p), LOWEST))
        assert instant.context[4 + k] == pytest.approx(-(p * np.log(p)).sum() / np.log(4), abs=2e-3)
    assert instant.context[:4] == pytest.approx([1, float(shown["over"]), np.log(np.clip(shown["elapsed"], 0.1, 3)), 0])
    assert float(instant.odds) == pytest.approx(np.log(trailing[-1] / trailing[:-1].sum()))
    assert instant.members[4] == pytest.approx(-np.minimum(shown["distances"], FARTHEST))
    ratio = np.clip(shown["distances"][:-1], 1 / FARTHEST, UNLIKE)
    assert instant.by_movement[0] == pytest.approx([*np.log(ratio), 0.0]), "unknown of the last"
    assert instant.by_movement[1] == pytest.approx(np.log(np.clip(shown["extents"], 0.05, 1)))
    together = np.prod([p ** (1 / 3) for p in members[1:]], axis=0)
    agreement = np.log((members[0] * together).sum() / together.sum())
    assert float(instant.agreement) == pytest.approx(agreement, abs=2e-3)


def losses():
    rng = np.random.default_rng(3)
    instants, truth, weights = instants_of(rng, 30), rng.integers(0, 4, 30), rng.uniform(0.1, 2, 30)
    p, _ = stacker_of(rng).judge(instants)
    return [(LabelLoss(instants, truth, weights), (J, Q)), (ElseLoss(instants, p, rng.random(30), weights), (G, R))]


@pytest.mark.parametrize(("loss", "shape"), losses(), ids=["movements", "something else"])
def test_gradients_are_those_of_finite_differences(loss, shape):
    w = np.random.default_rng(4).normal(0, 0.3, int(np.prod(shape)))
    error = check_grad(lambda x: loss(x.reshape(shape))[0], lambda x: loss(x.reshape(shape))[1], w)
    assert error < 1e-4 * np.linalg.norm(loss(w.reshape(shape))[1])


def rows_of(rng, count, stacker):
    """Instants whose truth is drawn from the stacker's own posterior."""
    instants = instants_of(rng, count)
    p, something_else = stacker.judge(instants)
    truth = np.array([rng.choice(4, p=row) for row in p])
    truth[rng.random(count) < something_else] = -1
    return StackerRows(instants, truth, np.ones(count), np.ones(count), truth >= 0)


def test_without_rows_it_is_the_mean_of_the_prior():
    rng = np.random.default_rng(0)
    nothing = rows_of(rng, 3, stacker_of(rng))
    nothing = StackerRows(nothing.instants.at(np.zeros(0, int)), *(np.zeros(0, int),) * 3, np.zeros(0, bool))
    for fitted in (fit(PRIOR, TASK_ONE, None), fit(PRIOR, TASK_ONE, nothing)):
        mean = PRIOR.stacker(TASK_ONE)
        assert (fitted.weights == mean.weights).all() and (fitted.other == mean.other).all()


def test_rows_that_teach_no_label_move_only_what_is_known_of_something_else():
    rng = np.random.default_rng(2)
    rows = replace(rows_of(rng, 50, stacker_of(rng)), teaches_label=np.zeros(50, bool))
    fitted, mean = fit(PRIOR, TASK_ONE, rows), PRIOR.stacker(TASK_ONE)
    assert (fitted.weights == mean.weights).all() and (fitted.other != mean.other).any()


def test_rows_move_it_as_far_as_they_are_evidence():
    rng, prior = np.random.default_rng(1), wide_prior()
    rows = rows_of(rng, 1500, stacker_of(rng))
    moving = rows.truth >= 0
    loss = LabelLoss(rows.instants.at(moving), rows.truth[moving], rows.weights[moving])
    best = minimize(lambda w: loss(w.reshape(J, Q)), np.zeros(J * Q), jac=True, method="L-BFGS-B").fun
    many = fit(prior, TASK_ONE, rows)
    at = np.flatnonzero(moving)[:1]
    one = StackerRows(rows.instants.at(at), rows.truth[at], rows.shown[at], rows.weights[at], np.array([True]))
    little = fit(prior, TASK_ONE, one)
    start, chance = prior.stacker(TASK_ONE), np.log(4)
    assert (loss(many.weights)[0] - best) / moving.sum() < 0.01, "many: the maximum likelihood"
    assert best / moving.sum() < chance - 0.1
    assert np.linalg.norm(little.weights - start.weights) < 0.5 * np.linalg.norm(many.weights - start.weights)
    p, something_else = many.judge(rows.instants)
    assert something_else.mean() == pytest.approx((~moving).mean(), abs=0.02)
    assert p[moving, rows.truth[moving]].mean() > 0.25


def test_a_narrow_prior_is_hardly_moved_and_the_task_chooses_its_mean():
    rng = np.random.default_rng(2)
    rows = rows_of(rng, 200, stacker_of(rng))
    fitted = fit(wide_prior(1e-4), TASK_ONE, rows)
    assert np.abs(fitted.weights).max() < 1e-3 and np.abs(fitted.other).max() < 1e-3
    means = rng.normal(size=(len(TASK), J, Q))
    expected = sum(z * mean for z, mean in zip((1.0, *np.log([5, 2, 4, 61])), means, strict=True))
    assert Gaussians(means, np.ones((J, Q))).at(TASK_ONE) == pytest.approx(expected)


@pytest.mark.parametrize("begin_known", [True, False])
def test_instants_without_a_movement_are_those_of_members_that_do_not_know_it(begin_known):
    rng = np.random.default_rng(5)
    shown = [raw(rng, 5, begin_known, begin_known, begin_known) for _ in range(40)]
    gone = rng.integers(0, 5, 40)
    struck = Instants.of([instant_of(**each) for each in shown]).without(gone)
    for n, (each, m) in enumerate(zip(shown, gone, strict=True)):
        others = np.arange(5) != m
        less = {**each, "log_trailing": np.where(np.append(others, True), each["log_trailing"], -700.0)}
        if begin_known:
            less["phase"] = each["phase"] * others / (each["phase"] * others).sum()
            less["log_segment"] = np.where(others, each["log_segment"], -700.0)
            less["distances"] = np.where(others, each["distances"], np.inf)
        expected, own = instant_of(**less), struck.at(np.array([n]))
        assert own.members[0] == pytest.approx(expected.members, abs=0.01)
        assert own.context[0] == pytest.approx(expected.context, abs=0.01)
        assert float(own.odds[0]) == pytest.approx(float(expected.odds), abs=0.01)
        assert float(own.agreement[0]) == pytest.approx(float(expected.agreement), abs=0.01)


@pytest.mark.parametrize(
    ("absent", "gone"),
    [({"phase": False}, [0]), ({"segment": False}, [2, 3]), ({"takes": False}, [4])],
    ids=["phase", "segment", "nearest"],
)
def test_a_member_that_does_not_judge_changes_nothing(absent, gone):
    rng = np.random.default_rng(6)
    instant, stacker = instant_of(**raw(rng, 4, **absent)), stacker_of(rng)
    other = replace(stacker, weights=stacker.weights.copy())
    other.weights[gone] += 5.0
    of_entropies = [4 + k for k in gone if k < 4]
    other.weights[:, of_entropies] -= 3.0
    for one, two in zip(stacker.judge(instant), other.judge(instant), strict=True):
        np.testing.assert_array_equal(one, two)


logs = st.floats(-1e4, 0)
anything = st.integers(2, 6).flatmap(
    lambda m: st.fixed_dictionaries(
        {
            "phase": st.none() | st.lists(st.floats(0, 1), min_size=m, max_size=m).map(np.array),
            "log_trailing": st.lists(logs, min_size=m + 1, max_size=m + 1).map(np.array),
            "log_segment": st.none()
            | st.lists(logs, min_size=2 * m, max_size=2 * m).map(lambda a: np.reshape(a, (2, m))),
            "distances": st.none()
            | st.lists(st.floats(0, 1e9) | st.just(math.inf), min_size=m, max_size=m).map(np.array),
            "extents": st.lists(st.floats(0, 1e9), min_size=m, max_size=m).map(np.array),
            "over": st.booleans(),
            "elapsed": st.floats(0, 1e6),
        }
    )
)


@cheap
@given(anything, st.integers(0, 99))
def test_whatever_members_say_the_posterior_is_a_distribution(shown, seed):
    instant = instant_of(**shown)
    for field in fields(Instants):
        assert np.isfinite(getattr(instant, field.name)).all(), field.name
    assert instant.members[:4].min() >= LOWEST and instant.members.max() <= 1e-9
    assert instant.members[4].min() >= -FARTHEST and abs(float(instant.odds)) <= MOST_ODDS
    for stacker in (stacker_of(np.random.default_rng(seed)), PRIOR.stacker(task_of(seed + 1, 1, 2, 3 * seed))):
        p, something_else = stacker.judge(instant)
        assert p.sum() == pytest.approx(1) and (p >= 0).all() and 0 <= something_else <= 1
