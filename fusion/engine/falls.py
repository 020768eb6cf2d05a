"""Whether somebody has fallen and not got up: stages from the evidence of several observers. Pure.

1. Two observers must agree where two see the person, and half of those that see them where more do: the evidence of all
   is the largest that so many reach.
2. `low`: the person lies, after they were seen up. `fallen`: they have lain for `after_s`. `up`: they are up again, or
   were seen up first. Before that the stage is `unknown`: somebody who lies from the start has not fallen.
3. A person who lies is often lost by trackers. Whoever was low for FIRM_S before still lies while nobody sees them.
4. An alarm ends only when somebody is seen up for UP_S, not because nobody is seen. Who lies with a probability below
   CLEAR_MARGIN is up beyond doubt; between that and 1/2 nothing changes.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from common import SECOND_NS
from common.fall_messages import FallStage
from fusion.engine.rest import CLEAR_MARGIN

FIRM_S = 0.2
"""With the smoothing of the evidence before (observer/preview/posture_outlet.py) the person has then lain for .3 s."""
UP_S = 1.0
"""Who rises a little and lies down again was not up."""


@dataclass(frozen=True, slots=True)
class FallState:
    """The stage, since when (ns), and k of the n observers that see the person hold that the person lies.

    lying: P(lying) of all observers together; None while nobody sees the person. number: of the fall, counted from 1;
    0 before the first."""

    stage: FallStage
    since_ns: int
    p: float | None = None
    k: int = 0
    n: int = 0
    number: int = 0


def pooled(lying: Mapping[str, float | None]) -> float | None:
    """P(lying) that enough observers reach (rule 1); None if nobody sees the person."""
    seen = sorted((p for p in lying.values() if p is not None), reverse=True)
    needed = max(min(2, len(seen)), (len(seen) + 1) // 2)
    return seen[needed - 1] if seen else None


class FallDetector:
    """Decides the stage. after_s: how long somebody must lie to have fallen."""

    def __init__(self, after_s: float) -> None:
        self._after_ns = round(after_s * SECOND_NS)
        self._state = FallState("unknown", 0)
        self._seen_ns = self._up_ns = 0

    def restore(self, stage: FallStage, since_ns: int, now_ns: int) -> None:
        """Continue from the stage of an earlier process; to be called before the first update."""
        self._state = FallState(stage, since_ns)
        self._seen_ns = self._up_ns = now_ns

    def update(self, lying: Mapping[str, float | None], now_ns: int) -> FallState:
        """The state at `now_ns`. lying: P(lying) by observer; None: it does not see the person well enough."""
        p = pooled(lying)
        seen = [each for each in lying.values() if each is not None]
        before, stage = self._state, self._stage(p, now_ns)
        # A fall is counted and dated from when the person began to lie.
        since_ns = before.since_ns if stage in (before.stage, "fallen") else now_ns
        number = before.number + (stage == "low" != before.stage)
        self._state = FallState(stage, since_ns, p, sum(each >= 0.5 for each in seen), len(seen), number)
        return self._state

    def _stage(self, p: float | None, now_ns: int) -> FallStage:
        stage, since_ns = self._state.stage, self._state.since_ns
        if p is not None:
            self._seen_ns = now_ns
        if p is None or p >= CLEAR_MARGIN:
            self._up_ns = now_ns
        if stage == "fallen":
            return "up" if now_ns - self._up_ns >= UP_S * SECOND_NS else "fallen"
        if stage == "low":
            if p is not None and p < CLEAR_MARGIN:
                return "up"
            if p is None and self._seen_ns - since_ns < FIRM_S * SECOND_NS:
                return "up"
            return "fallen" if now_ns - since_ns >= self._after_ns else "low"
        if p is None:
            return stage
        if stage == "up" and p >= 0.5:
            return "low"
        return "up" if p < 0.5 else stage
