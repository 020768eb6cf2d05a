"""Early words: a movement is named before it is decided, and its end confirms or takes back that word. Pure.

1. An undecided movement is named as soon as (1 - unlearned) p of the likeliest label reaches `certainty`; once.
2. Its last verdict, under the same id, settles the word: `confirmed`, `corrected` or `withdrawn`.
3. Not every movement gets a verdict: it may be too short, or the fusion service may restart. A word is withdrawn when
   judgements no longer name its movement, or when no judgement has named it for SILENT_S.
4. A label that was already this probable before the movement began belongs to the movement before; it does not count
   until its probability has dropped below `certainty` once.
5. After its end a movement gives rise to no more words, in whatever order messages arrive.
"""

import math
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Literal

from common.config_people import MOST_PEOPLE
from common.messages import JudgementMessage, OngoingMovement, VerdictMessage
from common.vocabulary import ABSTAIN
from hub.scene_state import is_waiting

Stage = Literal["early", "confirmed", "corrected", "withdrawn"]
ENDED_S = 0.5
"""A verdict precedes the judgement that no longer names its movement; it may arrive this much later."""
SILENT_S = 5.0
"""How long another fusion service may take to continue a movement."""
CLOSED_LIMIT = 64
NEVER = 1.0


@dataclass(frozen=True, slots=True)
class EarlyWord:
    """One word about the movement `id`: `label` is its label now, `early` the label of the first word.

    p: the probability of `early` when it was named. at_ns: when this was known, by the fusion machine's clock.
    """

    stage: Stage
    id: str
    label: str
    early: str
    p: float
    began_ns: int
    at_ns: int


@dataclass(slots=True)
class _Pending:
    word: EarlyWord
    last_named_s: float
    unnamed_since_s: float = math.inf


class Anticipation:
    """Turns judgements and verdicts into early words. `certainty`: 0 to 1, at NEVER there are none.

    Several people of a scene are anticipated each by themselves. Times are seconds of a clock that only advances.
    """

    def __init__(self, certainty: float) -> None:
        self._certainty = certainty
        self._pending: dict[str, _Pending] = {}
        self._closed: OrderedDict[str, None] = OrderedDict()
        self._label_before: str | None = None
        self._current_id, self._remembered_label = "", ""
        self._people: dict[str, Anticipation] = {}

    @property
    def open(self) -> tuple[EarlyWord, ...]:
        """The early words whose movements have not ended, the oldest first."""
        of_people = [word for person in self._people.values() for word in person.open]
        return *(pending.word for pending in self._pending.values()), *of_people

    def update(self, message: JudgementMessage, now_s: float) -> list[EarlyWord]:
        """The words that a judgement or a verdict gives rise to."""
        return (
            self._update(message, now_s) if message.person is None else self._of(message.person)._update(message, now_s)
        )

    def _of(self, person: str) -> "Anticipation":
        if person not in self._people and len(self._people) >= MOST_PEOPLE:
            # Names can be invented.
            self._people.clear()
        return self._people.setdefault(person, Anticipation(self._certainty))

    def _update(self, message: JudgementMessage, now_s: float) -> list[EarlyWord]:
        if isinstance(message, VerdictMessage):
            return [*self._settle(message, now_s), *self.expire(now_s)]
        movement = message.movement
        label = message.label if probability(message) >= self._certainty else ""
        remembered = movement is not None and self._is_remembered(movement.id, label)
        self._label_before = label
        for movement_id, pending in self._pending.items():
            if movement is not None and movement_id == movement.id:
                pending.last_named_s, pending.unnamed_since_s = now_s, math.inf
            else:
                pending.unnamed_since_s = min(pending.unnamed_since_s, now_s)
        words = [] if movement is None or remembered else self._name(message, movement, now_s)
        return [*self.expire(now_s), *words]

    def expire(self, now_s: float) -> list[EarlyWord]:
        """The words that are withdrawn because time has passed."""
        expired = [
            pending.word
            for pending in self._pending.values()
            if now_s - pending.unnamed_since_s > ENDED_S or now_s - pending.last_named_s > SILENT_S
        ]
        of_people = [word for person in self._people.values() for word in person.expire(now_s)]
        return [*(self._end(word, "withdrawn", ABSTAIN, word.at_ns) for word in expired), *of_people]

    def _is_remembered(self, movement_id: str, label: str) -> bool:
        """Rule 4; if nothing was received from before the movement, the label counts as remembered."""
        if movement_id != self._current_id:
            self._current_id = movement_id
            self._remembered_label = label if self._label_before is None else self._label_before
        if label != self._remembered_label:
            self._remembered_label = ""
        return self._remembered_label != ""

    def _name(self, message: JudgementMessage, movement: OngoingMovement, now_s: float) -> list[EarlyWord]:
        if not is_early(message, self._certainty) or movement.id in self._pending or movement.id in self._closed:
            return []
        label = message.label
        word = EarlyWord("early", movement.id, label, label, probability(message), movement.began_ns, message.at_ns)
        self._pending[movement.id] = _Pending(word, now_s)
        return [word]

    def _settle(self, verdict: VerdictMessage, now_s: float) -> list[EarlyWord]:
        pending = self._pending.get(verdict.id)
        if pending is None:
            # The verdict came first: no word can be early any more.
            self._close(verdict.id)
            return []
        pending.last_named_s, pending.unnamed_since_s = now_s, math.inf
        if verdict.ended_ns is None:
            return []
        stage: Stage = "confirmed" if verdict.label == pending.word.early else "corrected"
        if verdict.label == ABSTAIN:
            stage = "withdrawn"
        return [self._end(pending.word, stage, verdict.label, verdict.at_ns)]

    def _end(self, word: EarlyWord, stage: Stage, label: str, at_ns: int) -> EarlyWord:
        del self._pending[word.id]
        self._close(word.id)
        return replace(word, stage=stage, label=label, at_ns=at_ns)

    def _close(self, movement_id: str) -> None:
        self._closed[movement_id] = None
        self._closed.move_to_end(movement_id)
        while len(self._closed) > CLOSED_LIMIT:
            self._closed.popitem(last=False)


def probability(judgement: JudgementMessage) -> float:
    """The probability of the likeliest movement among all answers, "something else" included; 0 without observers."""
    if is_waiting(judgement):
        return 0.0
    return max(judgement.p, default=0.0) * (1.0 - (judgement.unlearned or 0.0))


def is_early(judgement: JudgementMessage, certainty: float) -> bool:
    """Whether its movement is undecided and probable enough to be named."""
    undecided = judgement.movement is not None and judgement.movement.label is None
    return undecided and certainty < NEVER and probability(judgement) >= certainty
