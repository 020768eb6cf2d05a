"""A limit on what one observer can say before verdicts have shown whether it can be believed. Pure.

All observers see the same movement at the same time. At the start of a scene, when nothing is known of them, one that
is much surer than all others may be a liar. So the surest observer weighs

    SURER I' / I,    at most 1, at least LEAST_INFLUENCE,

with I its information (reliability.py:information_of) and I' that of the next surest. The limit goes as evidence for it
comes, and is gone at PROVEN nats, which is two movements; then its certainty counts in full: a camera that sees well
among others that see little is the usual case in a room. Three observers have to know something, because of two
that differ either may be right.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

from fusion.engine.roster import AgedPosterior

SURER = 1.2
PROVEN = 2.0
"""Nats of evidence that what an observer publishes has to do with the verdicts (reliability.py)."""
LEAST_INFLUENCE = 0.1
KNOWS = 0.05
"""The third surest observer knows something from this information on, below it in proportion."""


def newcomers(observers: Iterable[str], evidence: Mapping[str, float]) -> Mapping[str, float]:
    """How far each observer is unproven, 0 to 1; those that are proven are left out. evidence: nats, by observer."""
    unproven = {observer: 1.0 - min(max(evidence.get(observer, 0.0) / PROVEN, 0.0), 1.0) for observer in observers}
    return {observer: share for observer, share in unproven.items() if share > 0.0}


def limit_newcomers(posteriors: Sequence[AgedPosterior], unproven: Mapping[str, float]) -> Sequence[AgedPosterior]:
    """The posteriors, the surest with less influence if it is a newcomer. unproven: as of `newcomers`."""
    if len(posteriors) < 3 or not unproven:
        return posteriors
    size = posteriors[0].p.size
    # Information times ln(size): its ratios are the same.
    nats = [math.log(size * one.p.item(one.p.argmax())) * (1.0 - (one.unlearned or 0.0)) for one in posteriors]
    third, second, first = sorted(nats)[-3:]
    if third <= 0.0 or SURER * second >= first:
        return posteriors
    place = nats.index(first)
    surest = posteriors[place]
    share = unproven.get(surest.observer, 0.0) * min(third / (KNOWS * math.log(size)), 1.0)
    if share == 0.0:
        return posteriors
    limit = max(SURER * second / first, LEAST_INFLUENCE)
    limited = surest.with_influence(1.0 - (1.0 - limit) * share)
    return [*posteriors[:place], limited, *posteriors[place + 1 :]]
