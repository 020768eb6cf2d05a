"""Pooling all that the judges say: movements, "something else", which way the person faces, and facets. Pure.

1. Who says how likely it is that the movement is none of the vocabulary adds an answer: q = ((1-u) p, u), prior
   uniform. Who does not say it is taken to be at the prior there, u = 1/(M+1). While nobody says it there is no such
   answer.
2. Who says P(facing | movement) believes q(m) P(k | m); who does not say it, or in another number of directions than
   most, is uniform over k: neutral. The rule weighs by the movements alone, mixes movement and facing together, and the
   facing is then summed out.
3. The temperature is that of the pooled belief over the answers; which way he faces, given the answer, stays as it is.
4. A facet is pooled by the same rule over those who say it.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from common.probability import Floats, decode_facing, temper, uniform
from fusion.engine.roster import AgedPosterior
from fusion.engine.rules import Rule
from fusion.engine.strengths import ObserverTrust

FACING = "facing"
FACETS_LIMIT = 32
"""So many facets are pooled: a peer that invents names for itself costs no more time."""


@dataclass(frozen=True, slots=True)
class JointPool:
    """cells (R, K), summing to 1, and the weights (N,) they were pooled with."""

    cells: Floats
    weights: Floats


@dataclass(frozen=True, slots=True)
class PooledPosterior:
    """What the judges together believe: p (M,) given that it is a movement of the vocabulary; facing (K,)."""

    p: Floats
    weights: Floats
    unlearned: float | None = None
    facing: Floats | None = None

    @property
    def answers(self) -> Floats:
        """(M,), or (M+1,) with "something else" last."""
        return self.p if self.unlearned is None else np.append(self.p * (1.0 - self.unlearned), self.unlearned)


@dataclass(frozen=True, slots=True)
class PoolingCase:
    """What `pool_posteriors` pools: one scene's."""

    rule: Rule
    posteriors: Sequence[AgedPosterior]
    prior: Floats
    temperature: float = 1.0


def pool_posteriors(case: PoolingCase) -> PooledPosterior:
    """All opinions, of at least one judge, by the rule (1 to 3)."""
    rule, opinions, prior, temperature = case.rule, case.posteriors, case.prior, case.temperature
    standing, rows, over = observer_trust(opinions), np.array([o.p for o in opinions]), prior
    extra = any(o.unlearned is not None for o in opinions)
    if extra:
        rows, over = _with_another_answer(rows, opinions), uniform(len(prior) + 1)
    facing = _facing(opinions, len(over))
    if facing is None:
        p, weights = _plain(rule, rows, over, standing)
        return _told(p if temperature == 1.0 else temper(p, over, 1.0 / temperature), weights, extra, None)
    joint = pool_joint(rule, rows[:, :, None] * facing, over, standing)
    answers = joint.cells.sum(axis=1)
    inside = joint.cells / np.maximum(answers, 1e-300)[:, None]
    tempered = answers if temperature == 1.0 else temper(answers, over, 1.0 / temperature)
    return _told(tempered, joint.weights, extra, tempered @ inside)


def pool_many(cases: Sequence[PoolingCase]) -> list[PooledPosterior]:
    """Each case as `pool_posteriors` pools it; those of a kind together, which takes a fraction of the time of each."""
    pools: list[PooledPosterior | None] = [None] * len(cases)
    alike: dict[object, list[int]] = {}
    for n, case in enumerate(cases):
        if case.rule.many and all(o.surprise is None for o in case.posteriors):
            extra = any(o.unlearned is not None for o in case.posteriors)
            kind = (case.rule.name, len(case.posteriors), len(case.prior), case.temperature, extra)
            alike.setdefault(kind, []).append(n)
        else:
            pools[n] = pool_posteriors(case)
    for places in alike.values():
        for n, pool in zip(places, _together([cases[n] for n in places]), strict=True):
            pools[n] = pool
    return [pool for pool in pools if pool is not None]


def _together(cases: Sequence[PoolingCase]) -> Iterator[PooledPosterior]:
    """Cases of one rule, number of judges, prior and temperature, who all say something else is possible, or none."""
    case = cases[0]
    rule, first, prior, temperature = case.rule, case.posteriors, case.prior, case.temperature
    extra = any(o.unlearned is not None for o in first)
    rows, over = np.array([[o.p for o in case.posteriors] for case in cases]), prior
    if extra:
        rows = np.array([_with_another_answer(r, c.posteriors) for r, c in zip(rows, cases, strict=True)])
        over = uniform(len(prior) + 1)
    pooled, weights = _plain(
        rule, rows, over, ObserverTrust.together([observer_trust(case.posteriors) for case in cases])
    )
    for p, shares in zip(pooled, weights, strict=True):
        yield _told(p if temperature == 1.0 else temper(p, over, 1.0 / temperature), shares, extra, None)


def pool_joint(rule: Rule, cells: Floats, prior: Floats, standing: ObserverTrust | None = None) -> JointPool:
    """cells (N, R, K) of N judges over R answers and K directions, prior (R,) over the answers: see 2."""
    if rule.weigh is None or rule.mix is None:
        size = cells.shape[2]
        pooled = rule.pool(cells.reshape(len(cells), -1), np.repeat(prior / size, size))
        return JointPool(pooled.p.reshape(-1, size), pooled.weights)
    found = rule.weigh(cells.sum(axis=2), prior, standing or ObserverTrust.unknown(len(cells)))
    return JointPool(rule.mix(cells, prior, found), found.shares)


def pool_facets(rule: Rule, opinions: Sequence[AgedPosterior]) -> dict[str, Floats]:
    """Every facet that somebody who is heard says (4)."""
    names = dict.fromkeys(name for o in opinions for name in o.facets if name != FACING)
    if not names:
        return {}
    standing, result = observer_trust(opinions), {}
    for name in sorted(names)[:FACETS_LIMIT]:
        size = _most(len(o.facets[name]) for o in opinions if name in o.facets)
        places = [n for n, o in enumerate(opinions) if name in o.facets and len(o.facets[name]) == size]
        if size >= 2:
            rows = np.array([opinions[n].facets[name] for n in places])
            result[name] = _plain(rule, rows, uniform(size), standing.of(places))[0]
    return result


def observer_trust(opinions: Sequence[AgedPosterior]) -> ObserverTrust:
    """What the opinions say of their judges."""
    if all(o.reliability == 1.0 and not o.correlations for o in opinions):
        return ObserverTrust.unknown(len(opinions))
    place = {o.observer: n for n, o in enumerate(opinions)}
    doubles = np.zeros((len(opinions), len(opinions)))
    for opinion in opinions:
        for other, rho in opinion.correlations.items():
            if other in place and other != opinion.observer:
                doubles[place[opinion.observer], place[other]] = rho
    return ObserverTrust(np.array([o.reliability for o in opinions]), doubles)


def facing_deg(facing: Floats) -> float:
    """(K,) -> degrees, 0 to 360: the mean direction of the likeliest and its neighbours."""
    size = len(facing)
    near = (int(facing.argmax()) + np.arange(-1, 2)) % size if size > 2 else np.array([int(facing.argmax())])
    angles = near * (2 * np.pi / size)
    return float(np.degrees(np.arctan2(facing[near] @ np.sin(angles), facing[near] @ np.cos(angles))) % 360)


def _plain(rule: Rule, rows: Floats, prior: Floats, standing: ObserverTrust) -> tuple[Floats, Floats]:
    if rule.weigh is None or rule.mix is None:
        pooled = rule.pool(rows, prior)
        return pooled.p, pooled.weights
    found = rule.weigh(rows, prior, standing)
    return rule.mix(rows[..., None], prior, found)[..., 0], found.shares


def _with_another_answer(rows: Floats, opinions: Sequence[AgedPosterior]) -> Floats:
    neutral = 1.0 / (rows.shape[1] + 1)
    unlearned = np.array([[neutral if o.unlearned is None else o.unlearned] for o in opinions])
    return np.hstack([rows * (1.0 - unlearned), unlearned])


def _facing(opinions: Sequence[AgedPosterior], answers: int) -> Floats | None:
    """(N, R, K) P(k | answer), uniform for who does not say it and for the answer that is no movement."""
    said = [o.surprise for o in opinions if o.surprise is not None]
    if not said:
        return None
    size = _most(table.shape[1] for table in said)
    facing = np.full((len(opinions), answers, size), 1.0 / size)
    for n, opinion in enumerate(opinions):
        table = opinion.surprise
        if table is not None and table.shape[1] == size:
            facing[n, : len(table)] = decode_facing(table)
    return facing


def _told(answers: Floats, weights: Floats, extra: bool, facing: Floats | None) -> PooledPosterior:
    if not extra:
        return PooledPosterior(answers, weights, None, facing)
    learned, unlearned = answers[:-1], float(answers[-1])
    total = float(learned.sum())
    # Should everybody be certain of something else, nothing is known of the movements.
    p = learned / total if total > 0 else uniform(len(learned))
    return PooledPosterior(p, weights, min(unlearned, 1.0), facing)


def _most(sizes: Iterable[int]) -> int:
    """The commonest; of equally common ones the largest."""
    counts = Counter(sizes)
    return max(counts, key=lambda size: (counts[size], size))
