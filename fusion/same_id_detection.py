"""Whether a second process with this service's id runs, and which of the two gives way. Pure: time is passed in.

The design: fusion.md, "Several services". The results are acted on by same_id.py and membership.py.

1. A message under this service's id with another session is only a suspicion: without certificates any process that
   reaches the mesh can send one. A suspicion that nothing confirms lapses.
2. The suspected process is then asked for its status, under this service's own exact key. ANSWERS answers with its
   session confirm it.
3. Of two, the one that stands by gives way to the one that publishes, then the one with the lower epoch, then the one
   with the lower session. So both decide on the same one.
4. One that is younger than YOUNG_S ends; until then it withholds its results, so that two that start together decide
   nothing twice. An older one stands by for as long as the other answers and publishes, and goes on after
   `takeover_s`, so that no other process can end it.

Times are seconds of a monotonic clock.
"""

from dataclasses import dataclass
from enum import Enum

ANSWERS = 3
"""Answers to different questions that confirm a suspicion; one may be a replayed message."""
ASK_EVERY_S = 0.3
LAPSE_S = 2.0
"""A suspicion lapses, and a confirmation ends, when nothing has been received for so long: several questions."""
YOUNG_S = 5.0
"""Two processes that were started together have received each other by then."""
SUSPECTS_LIMIT = 16
"""Suspected sessions that are followed at once, so that invented ones fill no memory."""


class Stance(Enum):
    """What a service does about another process with its id."""

    GO_ON = "go on"
    WAIT = "wait"
    STAND_BY = "stand by"
    END = "end"


@dataclass(slots=True)
class Suspect:
    """Another session under this service's id.

    since_s: its first message; received_s: its newest. published_s: its newest judgement; epoch: in it. answers: how
    many questions it has answered, the last at answered_s.
    """

    since_s: float
    received_s: float
    epoch: int = 0
    published_s: float = float("-inf")
    answers: int = 0
    answered_s: float = float("-inf")
    question: int = 0
    """The number of the newest question that it has answered."""

    def is_confirmed(self, now_s: float) -> bool:
        """Whether it has answered, and still does."""
        return self.answers >= ANSWERS and now_s - self.answered_s < LAPSE_S

    def has_lapsed(self, now_s: float) -> bool:
        """Whether nothing has been received from it for LAPSE_S."""
        return now_s - max(self.received_s, self.answered_s) >= LAPSE_S


class SameIdDetector:
    """Follows the other sessions under the id of the service with `session`, which began at `began_s`.

    takeover_s: a session that published no judgement for longer counts as standing by.
    """

    def __init__(self, session: str, began_s: float, takeover_s: float) -> None:
        self._session, self._began_s, self._takeover_s = session, began_s, takeover_s
        self._suspects: dict[str, Suspect] = {}
        self._question, self._asked_s = 0, float("-inf")

    @property
    def has_suspects(self) -> bool:
        """Whether a message of another session was received lately."""
        return bool(self._suspects)

    def record_message(self, session: str | None, now_s: float, epoch: int | None = None) -> None:
        """Take the session of a message under this service's id. epoch: of a judgement; None: it is a status."""
        if session is None or session == self._session:
            return
        suspect = self._suspects.get(session)
        if suspect is None or suspect.has_lapsed(now_s):
            self._drop_lapsed(now_s)
            if len(self._suspects) >= SUSPECTS_LIMIT:
                return
            suspect = self._suspects[session] = Suspect(now_s, now_s)
        suspect.received_s = now_s
        if epoch is not None:
            suspect.epoch, suspect.published_s = epoch, now_s

    def next_question(self, now_s: float, *, always: bool = False) -> int | None:
        """The number of the question to ask now; None if none is due. always: even if no session is suspected."""
        if self._suspects:
            self._drop_lapsed(now_s)
        if now_s - self._asked_s < ASK_EVERY_S or not (self._suspects or always):
            return None
        self._asked_s = now_s
        self._question += 1
        return self._question

    def record_answer(self, session: str | None, question: int, now_s: float) -> None:
        """Take an answer of the process with this session; only the first to each question counts."""
        suspect = self._suspects.get(session or "")
        if suspect is not None and question > suspect.question:
            suspect.question, suspect.answered_s = question, now_s
            suspect.answers += 1

    def is_confirmed(self, session: str | None, now_s: float) -> bool:
        """Whether a running process has this session."""
        suspect = self._suspects.get(session or "")
        return suspect is not None and suspect.is_confirmed(now_s)

    def any_confirmed(self, now_s: float) -> bool:
        """Whether another process with this id runs."""
        return any(suspect.is_confirmed(now_s) for suspect in self._suspects.values())

    def stance(self, epoch: int | None, now_s: float) -> Stance:
        """What this service does now (3, 4). epoch: its own; None while it does not own the scene."""
        stance = Stance.GO_ON
        for session, suspect in self._suspects.items():
            if self._precedence(suspect, session, now_s) < (epoch is not None, epoch or 0, self._session):
                continue
            confirmed, publishes = suspect.is_confirmed(now_s), self._publishes(suspect, now_s)
            if suspect.since_s - self._began_s < YOUNG_S:
                if confirmed:
                    return Stance.END
                if publishes and now_s - suspect.since_s < LAPSE_S:
                    stance = Stance.WAIT
            elif confirmed and publishes and epoch is not None:
                return Stance.STAND_BY
        return stance

    def _publishes(self, suspect: Suspect, now_s: float) -> bool:
        return now_s - suspect.published_s <= self._takeover_s

    def _precedence(self, suspect: Suspect, session: str, now_s: float) -> tuple[bool, int, str]:
        """The larger one stays (3)."""
        return self._publishes(suspect, now_s), suspect.epoch, session

    def _drop_lapsed(self, now_s: float) -> None:
        self._suspects = {
            session: suspect for session, suspect in self._suspects.items() if not suspect.has_lapsed(now_s)
        }
