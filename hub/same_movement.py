"""One id for each movement at a listener, also after a network was split (docs/reference/wire.md, `same_as`). Pure.

Each half of a split network has a fusion service of its own, and each service gives a movement an id of its own. The
service that stands down when the halves meet again ends its movement with `same_as`, the other's id.

1. A listener that knew the movement takes that message for its end, and ignores later words about the other id.
2. A listener that did not, or knows the end already, ignores the message: it has heard of the movement by the other id.
3. Two services may say the same, where a router froze at a takeover: the second of two equal words is ignored.
"""

from collections import OrderedDict
from typing import TypeVar

from common.messages import VerdictMessage

Value = TypeVar("Value")
LIMIT = 64
"""Movements that are remembered."""


class SameMovement:
    """Remembers which movements a listener knows; `passes` tells which verdicts it has to take."""

    def __init__(self) -> None:
        self._words: OrderedDict[str, tuple[str, str]] = OrderedDict()
        self._ended: OrderedDict[str, bool] = OrderedDict()
        self._ignored: OrderedDict[str, None] = OrderedDict()

    def passes(self, verdict: VerdictMessage) -> bool:
        """Whether the listener takes this verdict."""
        if verdict.same_as is None:
            word = verdict.stage, verdict.label
            if verdict.id in self._ignored or self._words.get(verdict.id) == word:
                return False
            _remember(self._words, verdict.id, word)
            ended = verdict.ended_ns is not None or self._ended.get(verdict.id, False)
            _remember(self._ended, verdict.id, ended)
            return True
        if self._ended.get(verdict.id) is not False:
            return False
        _remember(self._ended, verdict.id, True)
        if verdict.same_as and verdict.same_as not in self._ended:
            _remember(self._ignored, verdict.same_as, None)
        return True


def _remember(known: OrderedDict[str, Value], movement_id: str, value: Value) -> None:
    known[movement_id] = value
    if len(known) > LIMIT:
        known.popitem(last=False)
