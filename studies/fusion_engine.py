"""The fusion engine without a mesh: all that studies use of fusion, in one place. Pure."""

from collections.abc import Mapping

from common.messages import PosteriorMessage
from fusion.engine.engine import EngineOutput, FusionEngine
from fusion.engine.pooling import PoolingCase, facing_deg, pool_posteriors
from fusion.engine.roster import AgedPosterior
from fusion.engine.rules import DEFAULT_RULE, Rule, get_rule

# fmt: off
__all__ = [
    "DEFAULT_RULE", "AgedPosterior", "EngineOutput", "FusionEngine", "PoolingCase", "Rule",
    "facing_deg", "get_rule", "pool_posteriors", "step",
]
# fmt: on


def step(engine: FusionEngine, messages: Mapping[str, PosteriorMessage], now_ns: int) -> EngineOutput:
    """Give the engine one posterior per observer, received at `now_ns`, and take its judgement and verdicts."""
    for observer, message in messages.items():
        engine.receive(observer, message, now_ns)
    return engine.step(now_ns)
