"""Pooling of everything that observers publish: movements, "something else", facing and facets. Pure.

The design, with the numbers that the code names: fusion.md, "More than movements". Rest is pooled in rest.py.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from common import SECOND_NS
from common.posterior import FACETS_LIMIT
from common.probability import Floats, decode_facing, temper, uniform
from fusion.engine.aged_posterior import answers_of
from fusion.engine.roster import POOLED_STATES, AgedPosterior
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
        """Whether some observer publishes `unlearned`."""
        # Of four posteriors, a list takes half the time of `any`.
        return bool([posterior for posterior in self.posteriors if posterior.unlearned is not None])


def pool_posteriors(case: PoolingCase) -> PooledPosterior:
    """Pool the posteriors of at least one observer (1, 2, 4)."""
    has_unlearned, trust, rows = case.has_unlearned, observer_trust(case.posteriors), _rows(case)
    answers, prior = _answers(case, rows, has_unlearned), _prior(case, has_unlearned)
    pooled, facing = case.rule.pool(answers, prior, trust), _facing(case.posteriors, len(prior))
    if facing is None:
        return _result(case, rows, pooled)
    joint = pool_joint(case.rule, answers[:, :, None] * facing, prior, trust)
    pooled_answers = joint.p.sum(axis=1)
    # The divisor keeps an answer of probability 0 from giving a NaN.
    facing_given_answer = joint.p / np.where(pooled_answers > 0, pooled_answers, 1.0)[:, None]
    pooled = replace(pooled, p=pooled_answers, weights=joint.weights)
    return _result(case, rows, pooled, facing_given_answer)


def pool_many(cases: Sequence[PoolingCase]) -> list[PooledPosterior]:
    """Pool each case as `pool_posteriors` does, to the same bits; cases of equal shape together."""
    if len(cases) == 1:
        return [pool_posteriors(cases[0])]
    batches: dict[object, list[int]] = {}
    for n, case in enumerate(cases):
        has_facing = any(posterior.surprise is not None for posterior in case.posteriors)
        sizes = len(case.posteriors), len(case.prior)
        kind = (case.rule.name, *sizes, case.temperature, case.has_unlearned)
        batches.setdefault(n if has_facing or case.rule.pool_movements is None else kind, []).append(n)
    pooled = dict[int, PooledPosterior]()
    for places in batches.values():
        batch = [cases[n] for n in places]
        results = _pool_batch(batch) if len(batch) > 1 else map(pool_posteriors, batch)
        pooled.update(zip(places, results, strict=True))
    return [pooled[n] for n in range(len(cases))]


def _pool_batch(cases: Sequence[PoolingCase]) -> Iterator[PooledPosterior]:
    """Cases with equal rule, number of observers, prior and temperature, with `unlearned` in all of them or in none."""
    first = cases[0]
    has_unlearned, prior = first.has_unlearned, _prior(first, first.has_unlearned)
    rows = [_rows(case) for case in cases]
    answers = np.array([_answers(case, case_rows, has_unlearned) for case, case_rows in zip(cases, rows, strict=True)])
    trust = _stacked([observer_trust(case.posteriors) for case in cases])
    pooled = first.rule.pool(answers, prior, trust)
    for n, (case, case_rows) in enumerate(zip(cases, rows, strict=True)):
        hypotheses = None if pooled.hypotheses is None else pooled.hypotheses[n]
        last = None if pooled.last is None else pooled.last[n]
        yield _result(case, case_rows, RuleResult(pooled.p[n], pooled.weights[n], hypotheses, last))


def _stacked(trusts: Sequence[Trust]) -> Trust:
    """The trust in the observers of several scenes with as many observers each, (S, N)."""
    known = [trust for trust in trusts if trust is not None]
    return np.array([np.ones_like(known[0]) if trust is None else trust for trust in trusts]) if known else None


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
    batches: dict[tuple[Rule, int, int], list[tuple[dict[str, Floats], str, Sequence[Sequence[float]], Trust]]] = {}
    for case, pooled in zip(cases, results, strict=True):
        names = {name for posterior in case.posteriors for name in posterior.facets if name != FACING}
        trust = observer_trust(case.posteriors)
        # A limit for all observers together, so that invented names cost no time.
        for name in sorted(names)[:FACETS_LIMIT]:
            sizes = [len(posterior.facets.get(name, ())) for posterior in case.posteriors]
            size = _most_common([own for own in sizes if own])
            places = [n for n, own in enumerate(sizes) if own == size]
            rows = [case.posteriors[n].facets[name] for n in places]
            if size > 1:
                facet = pooled, name, rows, None if trust is None else trust[places]
                batches.setdefault((case.rule, size, len(places)), []).append(facet)
    for (rule, size, _), facets in batches.items():
        # (F, N, V): each sum was checked on arrival to be nearly 1.
        all_rows = np.array([rows for _, _, rows, _ in facets])
        all_rows /= all_rows.sum(axis=-1, keepdims=True)
        trusts, prior = [trust for *_, trust in facets], uniform(size)
        if rule.pool_movements is None or len(facets) == 1:
            posteriors = [rule.pool(own, prior, trust).p for own, trust in zip(all_rows, trusts, strict=True)]
        else:
            posteriors = list(rule.pool(all_rows, prior, _stacked(trusts)).p)
        for (pooled, name, *_), p in zip(facets, posteriors, strict=True):
            pooled[name] = p
    return [dict(sorted(pooled.items())) for pooled in results]


def newest_capture_ns(posteriors: Sequence[AgedPosterior], now_ns: int) -> int | None:
    """The capture time of the newest posterior that is pooled, at most `now_ns`; None without one."""
    ages_s = [each.age_s for each in posteriors if each.age_s is not None and each.state in POOLED_STATES]
    return now_ns - round(max(min(ages_s), 0.0) * SECOND_NS) if ages_s else None


def observer_trust(posteriors: Sequence[AgedPosterior]) -> Trust:
    """How far each observer is relied on."""
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
    observers, size = len(case.posteriors), len(case.prior)
    rows = np.empty((observers + 1, size))
    np.concatenate([posterior.p for posterior in case.posteriors], out=rows.reshape(-1)[: observers * size])
    return rows


def _answers(case: PoolingCase, rows: Floats, has_unlearned: bool) -> Floats:
    """(N, M), or (N, M+1) with "something else" last (1)."""
    if not has_unlearned:
        return rows[:-1]
    answers = [
        answers_of(posterior.p, posterior.unlearned) if posterior.answers is None else posterior.answers
        for posterior in case.posteriors
    ]
    return np.concatenate(answers).reshape(len(answers), -1)


def _prior(case: PoolingCase, has_unlearned: bool) -> Floats:
    """(M,), or uniform (M+1,) with "something else" last (1)."""
    return _uniform(len(case.prior) + 1) if has_unlearned else case.prior


def _facing(posteriors: Sequence[AgedPosterior], answers: int) -> Floats | None:
    """(N, R, K) P(k | answer), uniform where it is not published; None if no observer publishes it."""
    tables = [posterior.surprise for posterior in posteriors if posterior.surprise is not None]
    if not tables:
        return None
    size = _most_common([table.shape[1] for table in tables])
    facing = np.full((len(posteriors), answers, size), 1.0 / size)
    for n, posterior in enumerate(posteriors):
        table = posterior.surprise
        if table is not None and table.shape[1] == size:
            facing[n, : len(table)] = decode_facing(table)
    return facing


def _result(
    case: PoolingCase, rows: Floats, pooled: RuleResult, facing_given_answer: Floats | None = None
) -> PooledPosterior:
    """The pooled answers as movements and "something else"; the movements become the last of the rows."""
    answers, weights, has_unlearned = pooled.p, pooled.weights, len(pooled.p) > len(case.prior)
    if case.temperature != 1.0:
        answers = temper(answers, _prior(case, has_unlearned), 1.0 / case.temperature)
    facing = None if facing_given_answer is None else answers @ facing_given_answer
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
    """1, and of three and more participants "something else" without each that is not proven (1)."""
    proven = case.proven
    if proven is None or pooled.hypotheses is None or pooled.last is None:
        return [1.0]
    without = zip(case.posteriors, pooled.hypotheses[1:].tolist(), pooled.last[1:].tolist(), strict=False)
    return [1.0, *[last for each, doubt, last in without if doubt > 0.0 and not proven(each.observer)]]


_uniform = cache(uniform)
"""One read-only array for each number of answers."""


def _most_common(sizes: Sequence[int]) -> int:
    """The most common size; of equally common ones the largest."""
    return max(set(sizes), key=lambda size: (sizes.count(size), size))
