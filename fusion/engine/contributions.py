"""What a verdict is based on, and the contribution of each observer: the change when its posterior is left out. Pure.

The design: fusion.md, "What verdicts teach".
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.messages import Contribution, JudgementMessage
from common.probability import Floats
from fusion.engine.pooling import PoolingCase, pool_many, pool_posteriors
from fusion.engine.roster import POOLED_STATES, AgedPosterior
from fusion.engine.segments import PooledState

SMALLEST = 1e-12
"""Least probability in the log odds, so that a veto leaves them finite."""


@dataclass(slots=True)
class VerdictBasis:
    """A judgement that a verdict may be based on, its posteriors, and what a label lacked then.

    Without posteriors if it is a verdict, or came from another service. Nothing changes one.
    """

    judgement: JudgementMessage
    posteriors: Sequence[AgedPosterior] = ()
    why: str | None = None


NO_BASES: Mapping[int, VerdictBasis] = {}
"""By the time of the step, Unix epoch in ns."""


@dataclass(slots=True)
class NearestMiss:
    """The step at which the movement begun at `began_ns` came nearest to a verdict: its label's `p`, what it lacked."""

    began_ns: int = 0
    p: float = -1.0
    why: str | None = None


@dataclass(slots=True)
class LastObserved:
    """The last step, if an observer counted in it."""

    state: PooledState
    basis: VerdictBasis


def contributions(case: PoolingCase, label: int | None) -> dict[str, Contribution]:
    """The contribution to the answer `label`, in nats of log odds, of each observer whose posterior is pooled.

    label: index in the vocabulary; None for the likeliest answer, which may be "something else".
    """
    pooled = pool_posteriors(case).answers
    answer = int(pooled.argmax()) if label is None else label
    log_odds = _log_odds(pooled, answer)
    used = [n for n, posterior in enumerate(case.posteriors) if posterior.state in POOLED_STATES]
    if len(case.posteriors) > 1:
        cases = [replace(case, posteriors=[*case.posteriors[:n], *case.posteriors[n + 1 :]]) for n in used]
        without_each = [pool.answers for pool in pool_many(cases)]
    else:
        without_each = [case.prior] * len(used)
    result = {}
    for n, answers in zip(used, without_each, strict=True):
        if len(answers) < len(pooled):
            # Only this observer publishes `unlearned`: without it, something else is as likely as any movement.
            answers = np.append(answers * (1 - 1 / len(pooled)), 1 / len(pooled))
        without = _log_odds(answers, answer)
        result[case.posteriors[n].observer] = Contribution(nats=log_odds - without, stands=without > 0)
    return result


def _log_odds(answers: Floats, answer: int) -> float:
    """Nats, of an answer against the likeliest other one."""
    others = answers.tolist()
    own = others.pop(answer)
    return math.log(max(own, SMALLEST)) - math.log(max(*others, SMALLEST))
