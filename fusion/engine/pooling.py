"""Pooling of everything that observers publish: movements, "something else", facing and facets. Pure.

The design, with the numbers that the code names: fusion.md, "More than movements". Rest is pooled in rest.py.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from common import SECOND_NS
from common.posterior import FACETS_LIMIT
from common.probability import Floats, decode_facing, temper, uniform
from fusion.engine.aged_posterior import answers_of
from fusion.engine.roster import AgedPosterior
from fusion.engine.weighing import Rule, RuleResult, Trust

FACING = "facing"
FACETS_NS = SECOND_NS // 5
"""Between verdicts facets are pooled this seldom: people read them, and observers send new ones 10 times a second."""


@dataclass(slots=True)
class PooledPosterior:
    """The result of pooling: p (M,), given that it is a movement of the vocabulary; weights (N,); facing (K,).

    unlearned: the probability that it is none. rows (N + 1, M): the posteriors that were pooled, and then p. facets: by
    name; None: not pooled.
    """

    p: Floats
    weights: Floats
    unlearned: float | None
    facing: Floats | None
    rows: Floats
    facets: Mapping[str, Floats] | None = None

    @property
    def answers(self) -> Floats:
        """(M,), or (M+1,) with "something else" last."""
        return self.p if self.unlearned is None else np.append(self.p * (1.0 - self.unlearned), self.unlearned)


@dataclass(slots=True)
class PoolingCase:
    """The input of `pool_posteriors`: one scene at one time. with_facets: whether `pool_steps` pools the facets too.

    proven: whether an observer's labels have agreed with verdicts; None: all have.
    """

    rule: Rule
    posteriors: Sequence[AgedPosterior]
    prior: Floats
    temperature: float = 1.0
    with_facets: bool = True
    proven: Callable[[str], bool] | None = None

    @property
    def has_unlearned(self) -> bool:
        """Whether at least one observer publishes `unlearned`."""
        # Of four posteriors, a list takes half the time of `any`.
        return bool([posterior for posterior in self.posteriors if posterior.unlearned is not None])


def pool_posteriors(case: PoolingCase) -> PooledPosterior:
    """Pool the posteriors of at least one observer (1, 2, 4)."""
    has_unlearned, rows = case.has_unlearned, _rows(case)
    answers = _answers(case, rows, has_unlearned)
    pooled = case.rule.pool(answers, _prior(case, has_unlearned), observer_trust(case.posteriors))
    return _result(case, rows, pooled, answers)


def pool_many(cases: Sequence[PoolingCase]) -> list[PooledPosterior]:
    """Pool each case as `pool_posteriors` does, to the same bits; cases of equal shape together."""
    if len(cases) == 1:
        return [pool_posteriors(cases[0])]
    batches: dict[object, list[int]] = {}
    for n, case in enumerate(cases):
        kind = (case.rule.name, len(case.posteriors), len(case.prior), case.has_unlearned)
        batches.setdefault(kind, []).append(n)
    pooled = dict[int, PooledPosterior]()
    for places in batches.values():
        pooled.update(zip(places, _pool_batch([cases[n] for n in places]), strict=True))
    return [pooled[n] for n in range(len(cases))]


def _pool_batch(cases: Sequence[PoolingCase]) -> list[PooledPosterior]:
    """Cases with equal rule, number of observers and prior, with `unlearned` in all of them or in none."""
    has_unlearned = cases[0].has_unlearned
    prior, rows = _prior(cases[0], has_unlearned), [_rows(case) for case in cases]
    answers = [_answers(case, own, has_unlearned) for case, own in zip(cases, rows, strict=True)]
    pools = _pool_each(cases[0].rule, answers, prior, [case.posteriors for case in cases])
    return [
        _result(case, own_rows, pooled, own_answers)
        for case, own_rows, pooled, own_answers in zip(cases, rows, pools, answers, strict=True)
    ]


def _pool_each(
    rule: Rule, p: Sequence[Floats], prior: Floats, posteriors: Sequence[Sequence[AgedPosterior]]
) -> list[RuleResult]:
    """Pool each p (N, M), which `posteriors` publish; together, if the rule can."""
    trusts = [observer_trust(each) for each in posteriors]
    if len(p) == 1 or rule.pool_movements is None:
        return [rule.pool(own, prior, trust) for own, trust in zip(p, trusts, strict=True)]
    known = np.array([np.ones(len(p[0])) if trust is None else trust for trust in trusts])
    pooled = rule.pool(np.array(p), prior, known if known.min() < 1.0 else None)
    more = ([None] * len(p) if each is None else each for each in (pooled.hypotheses, pooled.likelihoods))
    return list(map(RuleResult, pooled.p, pooled.weights, *more))


def pool_joint(rule: Rule, cells: Floats, prior: Floats, trust: Trust = None) -> RuleResult:
    """Pool cells (N, R, K) of N observers over R answers and K directions, with prior (R,), to p (R, K) (2)."""
    weighed = rule.weigh(cells.sum(axis=2), prior, trust)
    return RuleResult(rule.mix(cells, prior, weighed), weighed.shares)


def pool_steps(cases: Sequence[PoolingCase]) -> list[PooledPosterior]:
    """Same as `pool_many`, with the facets of those that ask for them."""
    pools = pool_many(cases)
    due = [(pooled, case) for pooled, case in zip(pools, cases, strict=True) if case.with_facets]
    if due:
        for (pooled, _), facets in zip(due, pool_facets([case for _, case in due]), strict=True):
            pooled.facets = facets
    return pools


def pool_facets(cases: Sequence[PoolingCase]) -> list[dict[str, Floats]]:
    """Every facet that some observer publishes, by name, of each case (3); facets of equal shape together."""
    results: list[dict[str, Floats]] = [{} for _ in cases]
    batches: dict[tuple[Rule, int, int], list[tuple[dict[str, Floats], str, Sequence[AgedPosterior]]]] = {}
    for case, pooled in zip(cases, results, strict=True):
        names = {name for posterior in case.posteriors for name in posterior.facets if name != FACING}
        # A limit for all observers together, so that invented names cost no time.
        for name in sorted(names)[:FACETS_LIMIT]:
            size = _most_common([len(each.facets[name]) for each in case.posteriors if name in each.facets])
            publishing = [each for each in case.posteriors if len(each.facets.get(name, ())) == size]
            if size > 1:
                batches.setdefault((case.rule, size, len(publishing)), []).append((pooled, name, publishing))
    for (rule, size, _), facets in batches.items():
        # (F, N, V): each sum was checked on arrival to be nearly 1.
        rows = np.array([[each.facets[name] for each in publishing] for _, name, publishing in facets])
        pools = _pool_each(rule, rows / rows.sum(axis=-1, keepdims=True), uniform(size), [own for *_, own in facets])
        for (pooled, name, _), result in zip(facets, pools, strict=True):
            pooled[name] = result.p
    return [dict(sorted(pooled.items())) for pooled in results]


def newest_capture_ns(posteriors: Sequence[AgedPosterior], now_ns: int) -> int | None:
    """The capture time of the newest posterior of an observer that sees, at most `now_ns`; None without one."""
    ages_s = [each.age_s for each in posteriors if each.age_s is not None and each.sees]
    return now_ns - round(max(min(ages_s), 0.0) * SECOND_NS) if ages_s else None


def observer_trust(posteriors: Sequence[AgedPosterior]) -> Trust:
    """(N,) how far each observer is relied on, 0 to 1; None where all are fully."""
    reliability = [posterior.reliability for posterior in posteriors]
    return np.array(reliability) if min(reliability) < 1.0 else None


def facing_deg(facing: Floats) -> float:
    """(K,) -> degrees, from 0 to below 360: the mean direction of the likeliest facing and its two neighbours."""
    size, likeliest = len(facing), int(facing.argmax())
    near = (likeliest + np.arange(-1, 2)) % size if size > 2 else np.array([likeliest])
    angles = near * (2 * np.pi / size)
    degrees = float(np.degrees(np.arctan2(facing[near] @ np.sin(angles), facing[near] @ np.cos(angles))) % 360)
    # A tiny negative angle is rounded to 360.
    return degrees % 360


def _rows(case: PoolingCase) -> Floats:
    """(N + 1, M) the posteriors, and room for the pooled one."""
    return np.concatenate([*[each.p for each in case.posteriors], case.prior]).reshape(-1, len(case.prior))


def _answers(case: PoolingCase, rows: Floats, has_unlearned: bool) -> Floats:
    """(N, M), or (N, M+1) with "something else" last (1)."""
    if not has_unlearned:
        return rows[:-1]
    answers = [answers_of(each.p, each.unlearned) if each.answers is None else each.answers for each in case.posteriors]
    return np.concatenate(answers).reshape(len(answers), -1)


def _prior(case: PoolingCase, has_unlearned: bool) -> Floats:
    """(M,), or uniform (M+1,) with "something else" last (1)."""
    return _uniform(len(case.prior) + 1) if has_unlearned else case.prior


def _joint(case: PoolingCase, answers: Floats) -> tuple[RuleResult, Floats] | None:
    """The answers (N, R) pooled together with the facing, and (R, K) P(k | answer); None if nobody publishes it (2).

    Facing is uniform where it is not published.
    """
    tables = [each.surprise for each in case.posteriors if each.surprise is not None]
    if not tables:
        return None
    size = _most_common([table.shape[1] for table in tables])
    facing = np.full((*answers.shape, size), 1.0 / size)
    for own, table in zip(facing, [each.surprise for each in case.posteriors], strict=True):
        if table is not None and table.shape[1] == size:
            own[: len(table)] = decode_facing(table)
    prior = _prior(case, answers.shape[1] > len(case.prior))
    joint = pool_joint(case.rule, answers[:, :, None] * facing, prior, observer_trust(case.posteriors))
    p = joint.p.sum(axis=1)
    # The divisor keeps an answer of probability 0 from giving a NaN.
    return RuleResult(p, joint.weights), joint.p / np.where(p > 0, p, 1.0)[:, None]


def _result(case: PoolingCase, rows: Floats, pooled: RuleResult, own: Floats) -> PooledPosterior:
    """The pooled answers as movements and "something else"; the movements become the last of the rows.

    own: the answers of each observer.
    """
    joint = _joint(case, own)
    answers, weights = (pooled.p, pooled.weights) if joint is None else (joint[0].p, joint[0].weights)
    has_unlearned = len(answers) > len(case.prior)
    if case.temperature != 1.0:
        answers = temper(answers, _prior(case, has_unlearned), 1.0 / case.temperature)
    facing = None if joint is None else answers @ joint[1]
    if not has_unlearned:
        rows[-1] = answers
        return PooledPosterior(answers, weights, None, facing, rows)
    movements, unlearned = answers[:-1], answers.item(-1)
    total = float(np.add.reduce(movements))
    # If something else is certain, nothing is known about the movements.
    rows[-1] = p = movements / total if total > 0 else uniform(len(movements))
    if unlearned * len(answers) > 1.0:
        # Below its prior nobody claims something else.
        unlearned = min(unlearned, *_without_unproven(case, pooled))
    return PooledPosterior(p, weights, unlearned, facing, rows)


def _without_unproven(case: PoolingCase, pooled: RuleResult) -> list[float]:
    """Limits on "something else": 1, and what it is without each observer that is not proven (1).

    The second ones are there only where three or more observers participate.
    """
    proven, hypotheses, likelihoods = case.proven, pooled.hypotheses, pooled.likelihoods
    if proven is None or hypotheses is None or likelihoods is None:
        return [1.0]
    doubted = [n for n in range(1, len(hypotheses)) if hypotheses.item(n) > 0.0]
    unproven = [likelihoods[n] for n in doubted if not proven(case.posteriors[n - 1].observer)]
    # The prior of all answers is uniform.
    return [1.0, *[own.item(-1) / float(np.add.reduce(own)) for own in unproven]]


_uniform = cache(uniform)
"""One read-only array for each number of answers."""


def _most_common(sizes: Sequence[int]) -> int:
    """The most common size; of equally common ones the largest."""
    return max(set(sizes), key=lambda size: (sizes.count(size), size))
