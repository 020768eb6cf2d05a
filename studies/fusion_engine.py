"""The fusion engine without a mesh: all that studies use of fusion, in one place. Pure."""

from collections.abc import Mapping, Sequence

from common import SECOND_NS
from common.messages import PosteriorMessage
from common.vocabulary import ABSTAIN
from fusion.engine.engine import EngineOutput, FusionEngine
from fusion.engine.pooling import PooledPosterior, PoolingCase, facing_deg, pool_many, pool_posteriors
from fusion.engine.reliability import steadiness_after
from fusion.engine.roster import AgedPosterior
from fusion.engine.rules import DEFAULT_RULE, get_rule
from fusion.engine.weighing import Rule
from fusion.vocabulary_change import ObservedVocabularies

# fmt: off
__all__ = [
    "DEFAULT_RULE", "AgedPosterior", "EngineOutput", "FusionEngine", "ObservedVocabularies", "PooledPosterior",
    "PoolingCase", "Rule", "facing_deg", "first_word", "get_rule",
    "pool_many", "pool_posteriors", "steadiness_after", "step",
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
