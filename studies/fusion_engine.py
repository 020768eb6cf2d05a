"""The fusion engine without a mesh: all that studies use of fusion, in one place. Pure."""

from collections.abc import Mapping, Sequence

import numpy as np

from common import SECOND_NS
from common.messages import PosteriorMessage
from common.probability import Floats
from common.vocabulary import ABSTAIN
from fusion.engine.engine import EngineOutput, FusionEngine
from fusion.engine.pooling import PooledPosterior, PoolingCase, facing_deg, pool_many
from fusion.engine.roster import POOLED_STATES, AgedPosterior
from fusion.engine.rules import DEFAULT_RULE, get_rule
from fusion.engine.trust import HONEST, after_message, published_trust

# fmt: off
__all__ = [
    "DEFAULT_RULE", "POOLED_STATES", "AgedPosterior", "EngineOutput", "FusionEngine",
    "PooledPosterior", "PoolingCase", "facing_deg", "first_word", "get_rule", "pool_many",
    "steady_trusts", "step",
]
# fmt: on


def step(engine: FusionEngine, messages: Mapping[str, PosteriorMessage], now_ns: int) -> EngineOutput:
    """Give the engine one posterior per observer, received at `now_ns`, and take its judgement and verdicts."""
    for observer, message in messages.items():
        engine.receive(observer, message, now_ns)
    return engine.step(now_ns)


def first_word(
    engine: FusionEngine, cases: Sequence[PoolingCase], pooled: Sequence[PooledPosterior], rate_hz: float
) -> tuple[int, str] | None:
    """The frame and the label of the first verdict that names a movement; None without one.

    cases, pooled: one for each frame. rate_hz: frames a second.
    """
    for n, (case, posterior) in enumerate(zip(cases, pooled, strict=True)):
        at_ns = SECOND_NS + round(n * SECOND_NS / rate_hz)
        for verdict in engine.output_for(case.posteriors, at_ns, posterior).verdicts:
            if verdict.label != ABSTAIN:
                return n, verdict.label
    return None


def steady_trusts(answers: Floats, rate_hz: float) -> Floats:
    """(F, V, R) the answers of V observers in F frames -> (F, V) the trust in each by its own course over time."""
    frames, observers, size = answers.shape
    honest, trusts = [HONEST] * observers, np.ones((frames, observers))
    for n in range(1, frames):
        overlaps = size * (answers[n - 1] * answers[n]).sum(axis=1)
        honest = [after_message(own, float(o), 1.0 / rate_hz) for own, o in zip(honest, overlaps, strict=True)]
        trusts[n] = [published_trust(HONEST, own, sorted(honest)[observers // 2]) for own in honest]
    return trusts
