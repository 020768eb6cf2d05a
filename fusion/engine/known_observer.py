"""What the roster remembers of one observer: its newest message and its sessions (roster.py, rules 2 and 6)."""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from common.messages import PosteriorMessage, VoteState
from common.probability import Floats, Surprise

SESSIONS_KEPT = 64
"""Past sessions remembered per observer."""
TIMING_REASONS = ("repeated", "out_of_order", "past_session", "same_id")
"""Reasons for which a correct message is not used."""
NOTHING: Mapping[str, Floats] = {}


@dataclass(slots=True)
class KnownObserver:
    """p, rest, surprise, facets: of the newest message, as AgedPosterior has them while they are fresh; computed once
    per message instead of once per step. session_ns: when its session began here. visible_ns: when a body part was last
    seen.

    fault: the state that the last unusable message calls for. gone: the process disappeared after its last message.
    """

    past_sessions: deque[str] = field(default_factory=lambda: deque(maxlen=SESSIONS_KEPT))
    message: PosteriorMessage | None = None
    p: Floats = field(default_factory=lambda: np.empty(0))
    rest: float = 1.0
    surprise: Surprise | None = None
    facets: Mapping[str, Floats] = field(default_factory=dict)
    steadiness: float = 1.0
    steady_enough: float = 1.0
    session_ns: int = 0
    captured_ns: int = 0
    received_ns: int = 0
    visible_ns: int = 0
    gone: bool = False
    fault: VoteState | None = None
    rejected: Counter[str] = field(default_factory=Counter)

    def begin_session(self, message: PosteriorMessage, now_ns: int, captured_ns: int) -> None:
        """Begin the session of `message`, which is not the newest yet."""
        if self.message is not None:
            self.past_sessions.append(self.message.session)
        if message.session in self.past_sessions:
            self.past_sessions.remove(message.session)
        self.session_ns, self.visible_ns, self.steadiness = now_ns, captured_ns, 1.0

    def count_rejected(self, reason: str) -> None:
        """Count a message that was not used."""
        self.rejected[reason] += 1
        if reason not in TIMING_REASONS:
            self.fault = "foreign" if reason == "foreign_vocabulary" else "invalid"
