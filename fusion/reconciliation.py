"""After a network partition: the movement of the service that stands down for the owner, and what was sent meanwhile.
Pure: time is passed in.

The design: fusion.md, "Several services". The service that stands down sends its last judgement again, for the owner to
go on with its movement (FusionEngine.adopt), or ends it with `same_as`, so that each id has an end. Of movements that
both have judged to their end the owner says once which two ids are one (SharedMovements).
"""

from collections import deque

from common import SECOND_NS
from common.messages import JudgementMessage, VerdictMessage
from common.same_movement import LIMIT, SameMovement

ADOPTION_TIMEOUT_S = 0.5
ADOPTION_REPEAT_S = 0.15
"""So that the owner receives a lost judgement several times before ADOPTION_TIMEOUT_S."""
DETECTION_S = 0.5
"""A link may have been down for so long before this process noticed; what it sent meanwhile may be lost."""
SILENCE_S = 0.6
"""A router that is frozen for so long drops messages; a posterior of the slowest observer comes after 0.5 s."""
RECONNECTION_S = 0.3
"""So long after a router is back, all processes that try to reconnect have done so."""


class UnreconciledMovement:
    """The decided movement of a service that stood down at `since_ns`, until the owner continues it or it is ended.

    judgement: the last one, as it was published.
    """

    def __init__(self, verdict: VerdictMessage, since_ns: int, judgement: bytes | None = None) -> None:
        self.verdict, self.judgement = verdict, judgement
        self._since_ns, self._repeated_ns = since_ns, 0
        self._owners_movement = ""
        self.is_reconciled = False
        """Whether the owner continues the movement, or its end is published."""

    def record_message(self, message: JudgementMessage) -> None:
        """Take a message of the owner."""
        movement = message if isinstance(message, VerdictMessage) else message.movement
        if movement is None:
            return
        if movement.id == self.verdict.id:
            self.is_reconciled = True
        elif movement.label is not None:
            self._owners_movement = movement.id

    def should_repeat(self, now_ns: int) -> bool:
        """Whether the last judgement is to be sent again now; to be sent whenever this returns True."""
        if self.is_reconciled or self._owners_movement or now_ns - self._repeated_ns < ADOPTION_REPEAT_S * SECOND_NS:
            return False
        self._repeated_ns = now_ns
        return True

    def same_as(self, now_ns: int) -> str | None:
        """The value of `same_as` with which to end the movement now; None: it is not to be ended now.

        "" if the owner has decided no movement.
        """
        has_timed_out = now_ns - self._since_ns >= ADOPTION_TIMEOUT_S * SECOND_NS
        if self.is_reconciled or not (self._owners_movement or has_timed_out):
            return None
        self.is_reconciled = True
        return self._owners_movement


class SharedMovements:
    """The movements that this service has judged or followed, to compare with verdicts of another one."""

    def __init__(self) -> None:
        self._same, self._named = SameMovement(), deque[str](maxlen=LIMIT)

    def record(self, message: JudgementMessage) -> None:
        """Take a message that this service has published, or that an owner did which it followed."""
        if isinstance(message, VerdictMessage):
            self._same.take(message)
        else:
            self._same.judged(message)

    def goes_on(self, judgement: JudgementMessage) -> str | None:
        """The owner's id of the movement that goes on in a judgement of another service; None: it has none."""
        movement = judgement.movement
        if movement is None or movement.label is None:
            return None
        return self._same.known_as(judgement, movement.label, (movement.began_ns, judgement.at_ns))

    def same_as(self, verdict: VerdictMessage) -> str | None:
        """The owner's id of a movement whose end another service has published; None: it has none, or it was said."""
        if verdict.ended_ns is None or verdict.same_as is not None or verdict.id in self._named:
            return None
        first_id = self._same.first_id(verdict)
        if first_id is not None:
            self._named.append(verdict.id)
        return first_id


class Reachability:
    """Whether listeners receive what is published now: not while the link is down, nor for RECONNECTION_S after.

    Zenoh drops messages without a connection, and when a router is frozen. Listeners reconnect within the pauses
    between their attempts. Times are seconds of a monotonic clock.
    """

    def __init__(self) -> None:
        self._last_down_s: float | None = None
        self._heard_s = float("inf")
        self._gap_from_s, self._gap_until_s = float("inf"), float("-inf")

    def update(self, connected: bool, heard_s: float, now_s: float) -> bool:
        """Take whether the link is connected, and when a posterior was received last, at every step; returns whether
        listeners can be reached."""
        if heard_s - self._heard_s >= SILENCE_S:
            # The link may have been lost and opened again between two steps, or the router frozen.
            self._record_gap(self._heard_s, heard_s)
        self._heard_s = heard_s
        if not connected:
            self._record_gap(now_s, now_s)
            self._last_down_s = now_s
        elif self._last_down_s is not None and now_s - self._last_down_s >= RECONNECTION_S:
            self._last_down_s = None
        return self._last_down_s is None

    def lost_from(self, now_s: float) -> float:
        """Since when what was sent may not have arrived, once after each gap; infinite: everything arrived."""
        if now_s - self._gap_until_s < RECONNECTION_S:
            return float("inf")
        from_s, self._gap_from_s = self.doubtful_from_s, float("inf")
        return from_s

    @property
    def doubtful_from_s(self) -> float:
        """Since when what was sent may not have arrived, until that has been asked for once; infinite: all arrived."""
        return self._gap_from_s - DETECTION_S

    def _record_gap(self, from_s: float, until_s: float) -> None:
        self._gap_from_s, self._gap_until_s = min(from_s, self._gap_from_s), until_s
