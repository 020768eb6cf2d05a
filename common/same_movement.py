"""What a listener takes of verdicts: one id for each movement, by the rules of wire.md, "One movement, one name"; the
last ones, each movement once; and those of services that judge. Pure.

1. Of two equal messages the second is ignored, and so is what follows an end: what may have been lost is sent again.
2. A verdict of a process that nobody has heard of is nobody's judgement: anybody may publish on a mesh without
   certificates, and messages of another time are played onto it (`replay --onto`). A service is known by a judgement,
   and one that stands by, or has just started, by its status.
"""

from collections import OrderedDict
from dataclasses import dataclass

from common.fall_messages import FallMessage
from common.messages import JudgementMessage, StatusMessage, VerdictMessage

LIMIT = 64
"""Movements that are remembered."""


def is_same_movement(label: str, span: tuple[int, int], other_label: str, other_span: tuple[int, int]) -> bool:
    """Whether two verdicts are about one movement (rule 1). Spans: begin and end, ns."""
    shared_ns = min(span[1], other_span[1]) - max(span[0], other_span[0])
    shorter_ns = min(span[1] - span[0], other_span[1] - other_span[0])
    return label == other_label and shared_ns >= 0 and 2 * shared_ns >= shorter_ns


def span_of(verdict: VerdictMessage) -> tuple[int, int]:
    """Begin, and end or, while the movement goes on, the time of the verdict, ns."""
    return verdict.began_ns, verdict.at_ns if verdict.ended_ns is None else verdict.ended_ns


@dataclass(slots=True)
class _Known:
    """A movement as the listener knows it: its last message, and until when it went on, as far as is known."""

    verdict: VerdictMessage
    until_ns: int
    has_ended: bool = False


class SameMovement:
    """Remembers which movements a listener knows; `take` tells which verdicts it has to take, and under which id."""

    def __init__(self) -> None:
        self._known: OrderedDict[str, _Known] = OrderedDict()
        self._first_ids: OrderedDict[str, str] = OrderedDict()

    def take(self, verdict: VerdictMessage) -> VerdictMessage | None:
        """The verdict as the listener takes it, under the id that it knows; None: it is to be ignored."""
        known = self._known.get(verdict.id)
        if verdict.same_as is not None:
            return self._closed(verdict, known)
        first_id = self.first_id(verdict)
        if first_id is not None:
            return self._ended_by_other(verdict, self._known.get(first_id))
        if known is None:
            known = self._known[verdict.id] = _Known(verdict, 0)
            _forget(self._known)
        elif known.has_ended or (known.verdict.stage, known.verdict.label) == (verdict.stage, verdict.label):
            return None
        known.verdict, known.has_ended = verdict, verdict.ended_ns is not None
        known.until_ns = max(known.until_ns, span_of(verdict)[1])
        return verdict

    def first_id(self, verdict: VerdictMessage) -> str | None:
        """The id by which the movement of a verdict is known, if it is another one (rule 1)."""
        if verdict.id not in self._known and verdict.id not in self._first_ids:
            known_id = self.known_as(verdict, verdict.label, span_of(verdict))
            if known_id is not None:
                self._first_ids[verdict.id] = known_id
                _forget(self._first_ids)
        return self._first_ids.get(verdict.id)

    def judged(self, judgement: JudgementMessage) -> JudgementMessage:
        """The judgement with the id that the listener knows; its movement goes on."""
        movement = judgement.movement
        if movement is None:
            return judgement
        first_id = self._first_ids.get(movement.id, movement.id)
        known = self._known.get(first_id)
        if known is not None and not known.has_ended:
            known.until_ns = max(known.until_ns, judgement.at_ns)
        if first_id == movement.id or known is None:
            return judgement
        return judgement.model_copy(update={"movement": movement.model_copy(update={"id": first_id})})

    def known_as(self, message: JudgementMessage, label: str, span: tuple[int, int]) -> str | None:
        """The id of the movement of another service than the message's that has this label and span (rule 1)."""
        for first_id, known in reversed(self._known.items()):
            own = known.verdict
            if own.person != message.person or (own.fusion, own.session) == (message.fusion, message.session):
                continue
            if is_same_movement(own.label, (own.began_ns, known.until_ns), label, span):
                return first_id
        return None

    def _ended_by_other(self, verdict: VerdictMessage, known: _Known | None) -> VerdictMessage | None:
        """The end of a movement that is known by another id (rule 2)."""
        if known is None or known.has_ended or verdict.ended_ns is None or verdict.label != known.verdict.label:
            return None
        known.has_ended, own = True, known.verdict
        known.verdict = verdict.model_copy(update={"id": own.id, "began_ns": own.began_ns, "revises": own.revises})
        return known.verdict

    def _closed(self, verdict: VerdictMessage, known: _Known | None) -> VerdictMessage | None:
        """The end with `same_as` (rule 3)."""
        if known is None or known.has_ended:
            return None
        known.verdict, known.has_ended = verdict, True
        if verdict.same_as and verdict.same_as not in self._known:
            self._first_ids[verdict.same_as] = verdict.id
            _forget(self._first_ids)
        return verdict


def _forget(known: OrderedDict[str, _Known] | OrderedDict[str, str]) -> None:
    if len(known) > LIMIT:
        known.popitem(last=False)


Verdicts = tuple[VerdictMessage, ...]


def with_verdict(log: Verdicts, verdict: VerdictMessage, limit: int) -> Verdicts:
    """The `limit` newest arrivals, newest first; a later word on a known movement replaces the one before in place.

    The order is that of arrival: after a fusion machine's clock is set back, its new verdicts still show. Older words
    change nothing: the same object is returned.
    """
    for place, known in enumerate(log):
        if known.id == verdict.id:
            if (verdict.at_ns, verdict.stage == "ended") < (known.at_ns, known.stage == "ended"):
                return log
            return (*log[:place], verdict, *log[place + 1 :])
    return (verdict, *log)[:limit]


SERVICES_LIMIT = 64
"""Services that are remembered, each with its id and session: names can be invented, and a service that is started
again has a new session."""


class JudgingServices:
    """Remembers the newest SERVICES_LIMIT services."""

    def __init__(self) -> None:
        self._heard: OrderedDict[tuple[str, str | None], None] = OrderedDict()

    def hear(self, message: JudgementMessage | StatusMessage) -> None:
        """Take in a judgement that is no verdict, or a fusion service's status."""
        service = (message.fusion if isinstance(message, JudgementMessage) else message.id), message.session
        self._heard[service] = None
        self._heard.move_to_end(service)
        if len(self._heard) > SERVICES_LIMIT:
            self._heard.popitem(last=False)

    def knows(self, verdict: VerdictMessage | FallMessage) -> bool:
        """Whether the verdict, or the stage of a fall, is of a service that was heard of; true before the first one."""
        return not self._heard or (verdict.fusion, verdict.session) in self._heard
