"""What the page needs to know of a scene: its state, the longer verdict log, the last minute, who is there. Pure.

Times in it are the fusion machine's, so that judgements and verdicts lie on one line however wrong this clock is.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from common.messages import JudgementMessage, Message, VerdictMessage
from hub.anticipation import surest, unlearned_of
from hub.scene_state import SceneState

MINUTE_NS = 60_000_000_000
POINT_EVERY_NS = 200_000_000
LOG_LIMIT = 100
"""Verdicts that the page lists; `labanmesh capture` keeps all."""


@dataclass(frozen=True, slots=True)
class Point:
    """What was believed at one moment: the most probable movement, the probability of what is most probable, bits."""

    at_ns: int
    label: str
    p: float
    entropy: float


@dataclass(frozen=True, slots=True)
class Chronicle:
    """All the page shows at one moment. verdicts: newest first. seen, present: observers by their liveliness tokens."""

    state: SceneState
    verdicts: tuple[VerdictMessage, ...] = ()
    minute: tuple[Point, ...] = ()
    seen: frozenset[str] = frozenset()
    present: frozenset[str] = frozenset()

    @property
    def now_ns(self) -> int:
        """The fusion machine's time: its last judgement's and how long ago that was heard; ours before the first."""
        judgement, silence_s = self.state.judgement, self.state.silence_s
        if judgement is None or not math.isfinite(silence_s):
            return self.state.now_ns
        return judgement.at_ns + int(silence_s * 1e9)

    @property
    def gone(self) -> frozenset[str]:
        """Observers whose process was there and is not any more."""
        return self.seen - self.present

    def hear(self, state: SceneState, message: Message | None) -> "Chronicle":
        """The chronicle after `message` (None: only time has passed) made the scene's state this one."""
        match message:
            case VerdictMessage():
                return replace(self, state=state, verdicts=_logged(self.verdicts, message))
            case JudgementMessage():
                return replace(self, state=state, minute=_remembered(self.minute, point(message)))
            case _:
                return replace(self, state=state)

    def with_presence(self, present: Iterable[str]) -> "Chronicle":
        """The same, with who is there now; the very same when nobody came or went."""
        now = frozenset(present)
        return self if now == self.present else replace(self, present=now, seen=self.seen | now)


def point(judgement: JudgementMessage) -> Point:
    """A judgement as a point of the strip; what is no number is drawn as knowing nothing."""
    p = max(surest(judgement), unlearned_of(judgement.unlearned))
    bits = judgement.certainty_bits if math.isfinite(judgement.certainty_bits) else 0.0
    return Point(judgement.at_ns, judgement.label, p, max(0.0, bits))


def _remembered(minute: tuple[Point, ...], newest: Point) -> tuple[Point, ...]:
    """The last minute with the newest point; points of the future were there before a clock was set back."""
    if minute and 0 <= newest.at_ns - minute[-1].at_ns < POINT_EVERY_NS:
        return minute
    oldest_ns = newest.at_ns - MINUTE_NS
    return (*(each for each in minute if oldest_ns <= each.at_ns < newest.at_ns), newest)


def _logged(log: tuple[VerdictMessage, ...], verdict: VerdictMessage) -> tuple[VerdictMessage, ...]:
    """Newest heard first; said again it takes its place, unless that was the newer word."""
    for place, old in enumerate(log):
        if old.id == verdict.id:
            return log if verdict.at_ns < old.at_ns else (*log[:place], verdict, *log[place + 1 :])
    return (verdict, *log)[:LOG_LIMIT]
