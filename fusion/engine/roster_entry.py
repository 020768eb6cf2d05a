"""The state of one observer in the roster: its newest message and its sessions (roster.py, rules 2 and 6)."""

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from common.messages import PosteriorMessage, VoteState
from common.probability import Floats, Surprise

SESSIONS_LIMIT = 64
"""Past sessions that are remembered per observer."""
TIMING_REASONS = ("repeated", "out_of_order", "past_session", "same_id")
"""Reasons for which a correct message is not used."""
NO_FACETS: Mapping[str, Sequence[float]] = {}


@dataclass(slots=True)
class RosterEntry:
    """One observer's newest message, and what follows from it; computed once per message instead of once per step.

    p, rest, surprise, facets: as in AgedPosterior while fresh. steadiness: above 0 to 1; steady_enough: the share of
    the largest steadiness that counts as full (reliability.py, rule 6). session_ns: when its session began here.
    captured_ns, received_ns: of the newest message. visible_ns: capture of the newest frame that showed a body part.
    fault: the vote state after an unusable message; None after a usable one. gone: the process disappeared after its
    last message. All times by our clock, Unix epoch.
    """

    past_sessions: deque[str] = field(default_factory=lambda: deque(maxlen=SESSIONS_LIMIT))
    message: PosteriorMessage | None = None
    p: Floats = field(default_factory=lambda: np.empty(0))
    rest: float = 1.0
    surprise: Surprise | None = None
    facets: Mapping[str, Sequence[float]] = field(default_factory=dict)
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
