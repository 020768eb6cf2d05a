"""What becomes of the movement of a service that stands down because another one is the owner. Pure: time is passed in.

After a network was split, two services have published, each to its own listeners. When they hear each other again:

1. The service that stands down sends its last judgement again, some times, because the owner may not have heard of it
   yet. The owner takes over its decided movement, under its id, if it has decided none itself (FusionEngine.adopt).
2. If the owner's judgements show another decided movement, or have not shown this one for SETTLE_S, the service that
   stood down publishes the end of its movement with `same_as`. So each id has an end, and a listener knows which two
   are one movement.
"""

from common import SECOND_NS
from common.messages import JudgementMessage, VerdictMessage

SETTLE_S = 0.5
REPEAT_S = 0.15


class OpenMovement:
    """The decided movement of a service that stood down at `since_ns`, until somebody has ended it."""

    def __init__(self, verdict: VerdictMessage, since_ns: int) -> None:
        self.verdict, self._since_ns, self._repeated_ns = verdict, since_ns, 0
        self._other = ""
        self.settled = False
        """Whether nothing is left to do."""

    def note(self, message: JudgementMessage) -> None:
        """Take a message of the owner."""
        movement = message if isinstance(message, VerdictMessage) else message.movement
        if movement is None:
            return
        if movement.id == self.verdict.id:
            self.settled = True
        elif movement.label is not None:
            self._other = movement.id

    def is_to_repeat(self, now_ns: int) -> bool:
        """Whether the last judgement is to be sent again now."""
        if self.settled or self._other or now_ns - self._repeated_ns < REPEAT_S * SECOND_NS:
            return False
        self._repeated_ns = now_ns
        return True

    def same_as(self, now_ns: int) -> str | None:
        """The value for the message that ends the movement; None while there is no need for it."""
        if self.settled or (not self._other and now_ns - self._since_ns < SETTLE_S * SECOND_NS):
            return None
        self.settled = True
        return self._other
