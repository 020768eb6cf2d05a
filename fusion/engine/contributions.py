"""What each judge contributed to a verdict: what becomes of it when he is left out. Pure."""

import math
from collections.abc import Sequence

import numpy as np

from common.messages import Contribution
from common.probability import Floats
from fusion.engine.pooling import PoolingCase, pool_many, pool_posteriors
from fusion.engine.roster import HEARD, AgedPosterior
from fusion.engine.rules import Rule

SMALLEST = 1e-12
"""A veto counts as this probability: log odds stay finite."""


def contributions(
    rule: Rule, opinions: Sequence[AgedPosterior], prior: Floats, temperature: float, label: int | None
) -> dict[str, Contribution]:
    """Of each judge who is heard, to the answer `label`; None: to the likeliest of all, "something else" too."""
    whole = pool_posteriors(PoolingCase(rule, opinions, prior, temperature)).answers
    answer = int(whole.argmax()) if label is None else label
    odds = _log_odds(whole, answer)
    told = {}
    heard = [n for n, opinion in enumerate(opinions) if opinion.state in HEARD]
    without_each = [[*opinions[:n], *opinions[n + 1 :]] for n in heard] if len(opinions) > 1 else []
    pools = [pool.answers for pool in pool_many([PoolingCase(rule, o, prior, temperature) for o in without_each])]
    for n, left in zip(heard, pools or [prior] * len(heard), strict=True):
        if len(left) < len(whole):
            # He alone says that there may be something else: without him it is as likely as any.
            left = np.append(left * (1 - 1 / len(whole)), 1 / len(whole))
        without = _log_odds(left, answer)
        told[opinions[n].observer] = Contribution(nats=odds - without, stands=without > 0)
    return told


def _log_odds(answers: Floats, answer: int) -> float:
    best = float(np.delete(answers, answer).max())
    return math.log(max(float(answers[answer]), SMALLEST)) - math.log(max(best, SMALLEST))
