"""Whether a second process with this service's id lives, and which of the two gives way. Pure: time is passed in.

1. A message under this service's id with another session is a suspicion and no more: without certificates whoever
   reaches the mesh can send one. A suspicion that nothing confirms lapses.
2. The suspected process is then asked for its status, under this service's own exact key. ANSWERS answers with its
   session confirm it.
3. Of two, the one that stands by gives way to the one that publishes, then the one with the lower epoch, then the one
   with the lower session. So both decide on the same one.
4. One that is younger than YOUNG_S ends; until then it holds its results back, so that two that start together decide
   nothing twice. An older one stands by for as long as the other answers and publishes, and goes on after
   `takeover_s`: nobody can end it.
"""

from dataclasses import dataclass
from enum import Enum

ANSWERS = 3
ASK_EVERY_S = 0.3
LAPSE_S = 2.0
YOUNG_S = 5.0
SUSPECTS_LIMIT = 16
"""So many invented sessions are followed at once."""


class Stance(Enum):
    """What a service does about a process of its id."""

    GO_ON = "go on"
    WAIT = "wait"
    STAND_BY = "stand by"
    END = "end"


@dataclass(slots=True)
class Suspect:
    """Another session under this service's id. published_s: of its newest judgement; epoch: in it."""

    since_s: float
    heard_s: float
    epoch: int = 0
    published_s: float = float("-inf")
    answers: int = 0
    answered_s: float = float("-inf")
    question: int = 0
    """The newest question that it has answered."""

    def is_confirmed(self, now_s: float) -> bool:
        """Whether it has answered, and still does."""
        return self.answers >= ANSWERS and now_s - self.answered_s < LAPSE_S

    def has_lapsed(self, now_s: float) -> bool:
        """Whether nothing has been heard of it for long."""
        return now_s - max(self.heard_s, self.answered_s) >= LAPSE_S


class Twins:
    """The other sessions under the id of the service with `session`, which began at `began_s`.

    takeover_s: how long one that publishes may be silent.
    """

    def __init__(self, session: str, began_s: float, takeover_s: float) -> None:
        self._session, self._began_s, self._takeover_s = session, began_s, takeover_s
        self._suspects: dict[str, Suspect] = {}
        self._question, self._asked_s = 0, float("-inf")

    @property
    def has_suspects(self) -> bool:
        """Whether another session was heard lately."""
        return bool(self._suspects)

    def heard(self, session: str | None, now_s: float, epoch: int | None = None) -> None:
        """A message under this service's id. epoch: of a judgement; None: it is a status."""
        if session is None or session == self._session:
            return
        suspect = self._suspects.get(session)
        if suspect is None or suspect.has_lapsed(now_s):
            self._drop_lapsed(now_s)
            if len(self._suspects) >= SUSPECTS_LIMIT:
                return
            suspect = self._suspects[session] = Suspect(now_s, now_s)
        suspect.heard_s = now_s
        if epoch is not None:
            suspect.epoch, suspect.published_s = epoch, now_s

    def question(self, now_s: float, *, always: bool = False) -> int | None:
        """The number of a question that is to be asked now; None: none. always: even if nobody is suspected."""
        if self._suspects:
            self._drop_lapsed(now_s)
        if now_s - self._asked_s < ASK_EVERY_S or not (self._suspects or always):
            return None
        self._asked_s = now_s
        self._question += 1
        return self._question

    def answered(self, session: str | None, question: int, now_s: float) -> None:
        """A process with this session has answered that question; a second answer to it counts no more."""
        suspect = self._suspects.get(session or "")
        if suspect is not None and question > suspect.question:
            suspect.question, suspect.answered_s = question, now_s
            suspect.answers += 1

    def confirmed(self, session: str | None, now_s: float) -> bool:
        """Whether a living process has this session."""
        suspect = self._suspects.get(session or "")
        return suspect is not None and suspect.is_confirmed(now_s)

    def any_confirmed(self, now_s: float) -> bool:
        """Whether any other process of this id lives."""
        return any(suspect.is_confirmed(now_s) for suspect in self._suspects.values())

    def stance(self, epoch: int | None, now_s: float) -> Stance:
        """What this service does now. epoch: its own; None while it does not own the scene."""
        stance = Stance.GO_ON
        for session, suspect in self._suspects.items():
            if self._order(suspect, session, now_s) < (epoch is not None, epoch or 0, self._session):
                continue
            confirmed, publishes = suspect.is_confirmed(now_s), now_s - suspect.published_s <= self._takeover_s
            if suspect.since_s - self._began_s < YOUNG_S:
                if confirmed:
                    return Stance.END
                if publishes and now_s - suspect.since_s < LAPSE_S:
                    stance = Stance.WAIT
            elif confirmed and publishes and epoch is not None:
                return Stance.STAND_BY
        return stance

    def _order(self, suspect: Suspect, session: str, now_s: float) -> tuple[bool, int, str]:
        return now_s - suspect.published_s <= self._takeover_s, suspect.epoch, session

    def _drop_lapsed(self, now_s: float) -> None:
        self._suspects = {name: each for name, each in self._suspects.items() if not each.has_lapsed(now_s)}
