"""Early words: a movement is named before it is decided, and that word is confirmed or taken back at its end. Pure.

1. A movement that goes on undecided is named as soon as (1 - unlearned) p of the likeliest label is `certainty`; once.
2. Its last verdict, under the same id, says whether that was right: `confirmed`, `corrected` or `withdrawn`.
3. Not every movement has a verdict: what lasts too short is none, and a fusion service that starts afresh forgets. A
   movement that the referee names no more, or that nobody has named for long, is withdrawn.
4. What was believed as surely before the movement began is memory of the one before, until it has been doubted once.
5. After its end nothing more is said of an id, in whatever order messages come.
"""

import math
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Literal

from common.messages import JudgementMessage, OngoingMovement, VerdictMessage
from common.vocabulary import ABSTAIN

Stage = Literal["early", "confirmed", "corrected", "withdrawn"]
ENDED_S = 0.5
"""A verdict is said before the judgement that names its movement no more; it may come so much after it."""
SILENT_S = 5.0
"""So long another fusion service may take to go on, or the same to start again with its memory."""
REMEMBERED = 64
NEVER = 1.0


@dataclass(frozen=True, slots=True)
class Word:
    """What is said of the movement `id`: `label` is what it is held for now, `early` what it was at first.

    p: the probability of `early` when that was said. at_ns: by the referee's clock, when this was known.
    """

    stage: Stage
    id: str
    label: str
    early: str
    p: float
    began_ns: int
    at_ns: int


@dataclass(slots=True)
class _Open:
    word: Word
    named_s: float
    unnamed_s: float = math.inf


class Anticipation:
    """Messages in, words out; `certainty` from 0 to 1, at NEVER no early word. Times only go on, in seconds."""

    def __init__(self, certainty: float) -> None:
        self._certainty = certainty
        self._open: dict[str, _Open] = {}
        self._closed: OrderedDict[str, None] = OrderedDict()
        self._before: str | None = None
        self._current, self._memory = "", ""

    @property
    def open(self) -> tuple[Word, ...]:
        """The early words whose movements have not ended, the oldest first."""
        return tuple(each.word for each in self._open.values())

    def hear(self, message: JudgementMessage, now_s: float) -> list[Word]:
        """What a judgement or a verdict gives rise to."""
        if isinstance(message, VerdictMessage):
            return [*self._verdict(message, now_s), *self.wait(now_s)]
        movement = message.movement
        held = message.label if surest(message) >= self._certainty else ""
        remembered = movement is not None and self._is_memory(movement.id, held)
        self._before = held
        for verdict_id, each in self._open.items():
            if movement is not None and verdict_id == movement.id:
                each.named_s, each.unnamed_s = now_s, math.inf
            else:
                each.unnamed_s = min(each.unnamed_s, now_s)
        said = [] if movement is None or remembered else self._early(message, movement, now_s)
        return [*self.wait(now_s), *said]

    def wait(self, now_s: float) -> list[Word]:
        """Time has passed."""
        gone = [
            each.word
            for each in self._open.values()
            if now_s - each.unnamed_s > ENDED_S or now_s - each.named_s > SILENT_S
        ]
        return [self._end(word, "withdrawn", ABSTAIN, word.at_ns) for word in gone]

    def _is_memory(self, verdict_id: str, held: str) -> bool:
        """Rule 4; who has heard nothing from before the movement cannot tell, and takes it for memory."""
        if verdict_id != self._current:
            self._current, self._memory = verdict_id, held if self._before is None else self._before
        if held != self._memory:
            self._memory = ""
        return self._memory != ""

    def _early(self, message: JudgementMessage, movement: OngoingMovement, now_s: float) -> list[Word]:
        if not is_early(message, self._certainty) or movement.id in self._open or movement.id in self._closed:
            return []
        label = message.label
        word = Word("early", movement.id, label, label, surest(message), movement.began_ns, message.at_ns)
        self._open[movement.id] = _Open(word, now_s)
        return [word]

    def _verdict(self, verdict: VerdictMessage, now_s: float) -> list[Word]:
        waiting = self._open.get(verdict.id)
        if waiting is None:
            # The referee's own word has come: nothing can be early any more.
            self._close(verdict.id)
            return []
        waiting.named_s, waiting.unnamed_s = now_s, math.inf
        if verdict.ended_ns is None:
            return []
        same: Stage = "confirmed" if verdict.label == waiting.word.early else "corrected"
        stage: Stage = "withdrawn" if verdict.label == ABSTAIN else same
        return [self._end(waiting.word, stage, verdict.label, verdict.at_ns)]

    def _end(self, word: Word, stage: Stage, label: str, at_ns: int) -> Word:
        del self._open[word.id]
        self._close(word.id)
        return replace(word, stage=stage, label=label, at_ns=at_ns)

    def _close(self, verdict_id: str) -> None:
        self._closed[verdict_id] = None
        self._closed.move_to_end(verdict_id)
        while len(self._closed) > REMEMBERED:
            self._closed.popitem(last=False)


def surest(judgement: JudgementMessage) -> float:
    """The probability of the likeliest movement among all answers, "something else" included."""
    p = max((each for each in judgement.p if 0 <= each <= 1), default=0.0)
    return p * (1.0 - unlearned_of(judgement.unlearned))


def unlearned_of(said: float | None) -> float:
    """The chance of "something else" as a share; 0 where nobody, or no number, says it."""
    return said if said is not None and 0 <= said <= 1 else 0.0


def is_early(judgement: JudgementMessage, certainty: float) -> bool:
    """Whether its movement is undecided and could be named."""
    undecided = judgement.movement is not None and judgement.movement.label is None
    return undecided and certainty < NEVER and surest(judgement) >= certainty
