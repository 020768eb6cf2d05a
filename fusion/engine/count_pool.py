"""How often a periodic movement has been repeated, from what the observers count: a median weighted by trust. Pure.

An observer weighs by the trust in it, by how fresh its count is, and by how far the movement swings in its view,
between half and all of that: a view along the movement misses repetitions. So of three and more equally trusted
observers no single one outweighs the others, whatever it counts (docs/design/fusion.md, "Segments").
"""

from collections.abc import Iterable, Mapping, Sequence
from math import floor
from typing import NamedTuple

from common.messages import JudgementMessage, Vote
from fusion.engine.aged_posterior import AgedPosterior


class RepetitionCount(NamedTuple):
    """How often a movement has been done so far, and how many of these repetitions are partial."""

    done: int
    partial: int = 0


def repetitions_of(
    label: str, posteriors: Iterable[AgedPosterior], votes: Mapping[str, Vote]
) -> RepetitionCount | None:
    """How often `label` has been done so far, as the observers count that vote for it; None: nobody counts."""
    return pooled_repetitions([each for each in posteriors if votes[each.observer].label == label])


def pooled_repetitions(posteriors: Iterable[AgedPosterior]) -> RepetitionCount | None:
    """The weighted median of the counts of these observers; None: nobody counts."""
    counting = [each for each in posteriors if each.repetitions is not None]
    if not counting:
        return None
    widest = max(0.0 if each.repeated is None else each.repeated.swing for each in counting) or 1.0
    weights = [_weight(each, widest) for each in counting]
    count = _whole(weighted_median([each.repetitions or 0.0 for each in counting], weights))
    partial = weighted_median([0.0 if each.repeated is None else each.repeated.partial for each in counting], weights)
    return RepetitionCount(count, min(_whole(partial), count))


def _weight(posterior: AgedPosterior, widest: float) -> float:
    """widest: the largest swing of all observers. One that does not tell its swing weighs as one that sees none."""
    share = 0.0 if posterior.repeated is None else posterior.repeated.swing / widest
    return posterior.reliability * posterior.freshness * (1.0 + share) / 2


def weighted_median(values: Sequence[float], weights: Sequence[float]) -> float:
    """The value at which half of the weight is reached; the mean with the next one where it is reached exactly.

    Without any weight all count alike. values: at least one.
    """
    total = sum(weights)
    if total <= 0.0:
        weights, total = [1.0] * len(values), float(len(values))
    ordered, below = sorted(zip(values, weights, strict=True)), 0.0
    for place, (value, weight) in enumerate(ordered):
        below += weight
        # Sums of weights have round-off.
        if abs(2 * below - total) <= 1e-9 * total and place + 1 < len(ordered):
            return (value + ordered[place + 1][0]) / 2
        if 2 * below > total:
            return value
    return ordered[-1][0]


def _whole(periods: float) -> int:
    """Whole repetitions: one in progress counts from its far turning point on, not when it has begun."""
    return floor(periods)


def counted_in(judgement: JudgementMessage) -> RepetitionCount | None:
    """What a judgement or verdict says."""
    done, partial = judgement.repetitions, judgement.partial_repetitions
    return None if done is None else RepetitionCount(done, partial or 0)


def repetition_fields(repetitions: RepetitionCount | None) -> dict[str, int | None]:
    """The fields of a judgement or verdict; of a movement of which no repetition is partial, that is left out."""
    done, partial = repetitions or (None, None)
    return {"repetitions": done, "partial_repetitions": partial or None}
