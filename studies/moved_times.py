"""Captured messages as they would be said now: their times moved, everything else as it was. Pure: time is passed in.

1. What an observer says of itself keeps its age: captured as long before it is sent now as it was then. Successive
   messages of one session are never dated alike, since a clock that stands still is not believed.
2. What the referee said lies on one line of time, so that the sayings of one verdict agree on when it began. Played as
   fast as possible, that line ends now.
3. A replay is a new start of every process: sessions get a name of their own, so that the same capture can be heard
   twice. At another speed, spans of time shrink with it.
"""

from dataclasses import dataclass, field
from typing import Any

from common.capture_file import CaptureRecord
from common.messages import (
    JudgementMessage,
    Message,
    OngoingMovement,
    PosteriorMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
)
from common.wire import BadMessage, decode, encode

KINDS: dict[str, type[Message]] = {
    "posterior": PosteriorMessage,
    "status": StatusMessage,
    "judgement": JudgementMessage,
    "verdict": VerdictMessage,
    "vocabulary": VocabularyMessage,
}
"""What is spoken where: the last part of a key names the kind of message."""
SESSION_KEPT = 40
"""Characters of a recorded session's name that stay readable in the new one."""


@dataclass(slots=True)
class MovedTimes:
    """How a capture of first_ns to last_ns, played from start_ns on, is dated; speed 0 is as fast as possible.

    `scene` is whose mesh it is played onto, `run` is a name of this replay for the sessions.
    """

    first_ns: int
    last_ns: int
    start_ns: int
    speed: float
    scene: str
    run: str
    _newest: dict[str, tuple[int, int]] = field(default_factory=dict)

    def due_ns(self, arrived_ns: int) -> int:
        """When that is to be sent which arrived then."""
        return self.start_ns + round((arrived_ns - self.first_ns) / self.speed) if self.speed else self.start_ns

    def payload(self, record: CaptureRecord, now_ns: int) -> bytes:
        """The bytes to send at `now_ns`; what cannot be read goes as it is, for it was said like that."""
        kind = KINDS.get(record.key.rsplit("/", 1)[-1])
        try:
            message = None if kind is None else decode(kind, record.payload)
        except BadMessage:
            message = None
        if message is None:
            return record.payload
        return encode(message.model_copy(update={"scene": self.scene} | self._moved(message, record, now_ns)))

    def _moved(self, message: Message, record: CaptureRecord, now_ns: int) -> dict[str, Any]:
        match message:
            case PosteriorMessage():
                return self._posterior(message, record.arrived_ns, now_ns)
            case StatusMessage():
                last_ns = message.last_frame_ns
                seen_ns = None if last_ns is None else now_ns - self._span(record.arrived_ns - last_ns)
                return {"last_frame_ns": seen_ns, "at_ns": None if message.at_ns is None else now_ns}
            case JudgementMessage():
                return self._judgement(message)
            case _:
                return {}

    def _posterior(self, message: PosteriorMessage, arrived_ns: int, now_ns: int) -> dict[str, Any]:
        name = f"{message.observer} {message.session}"
        before_captured_ns, before_sent_ns = self._newest.get(name, (0, 0))
        captured_ns = max(now_ns - self._span(arrived_ns - message.captured_ns), before_captured_ns + 1)
        sent_ns = max(now_ns - self._span(arrived_ns - message.sent_ns), before_sent_ns + 1, captured_ns)
        self._newest[name] = captured_ns, sent_ns
        session = f"{message.session[:SESSION_KEPT]}-{self.run}"
        return {"captured_ns": captured_ns, "sent_ns": sent_ns, "session": session}

    def _judgement(self, message: JudgementMessage) -> dict[str, Any]:
        moved: dict[str, Any] = {"at_ns": self._on_line(message.at_ns)}
        if message.movement is not None:
            moved["movement"] = message.movement.model_copy(update=self._span_of(message.movement))
        return moved | self._span_of(message) if isinstance(message, VerdictMessage) else moved

    def _span_of(self, said: OngoingMovement | VerdictMessage) -> dict[str, Any]:
        """The times of a movement, and its id, which is made from them."""
        times = {name: getattr(said, name, None) for name in ("began_ns", "decided_ns", "ended_ns")}
        moved = {name: self._on_line(at_ns) for name, at_ns in times.items() if at_ns is not None}
        return {**moved, "id": f"{self.scene}-{moved['began_ns'] // 1_000_000}"}

    def _on_line(self, at_ns: int) -> int:
        return self.due_ns(at_ns) if self.speed else self.start_ns - (self.last_ns - at_ns)

    def _span(self, span_ns: int) -> int:
        return round(span_ns / self.speed) if self.speed else span_ns
