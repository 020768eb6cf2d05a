"""One phone's WebSocket, without the socket: what its messages cause. Pure.

1. The first message joins or resumes; anything else before it, and any message that breaks a rule, ends the connection
   with one line.
2. At most MOST_HZ messages a second; the page sends the next tracks only when few are not acknowledged, so that what
   waited on a slow line is never more than that.
3. Tracks go on as a line of another program's tracks (docs/guide/cameras.md), in our time.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from common import SECOND_NS
from hub.phone.phone_clock import PhoneClock
from hub.phone.phone_messages import (
    BadPhoneMessage,
    CameraState,
    ClockAnswer,
    Join,
    LessonRequest,
    PhoneTracks,
    Resume,
    read_message,
)
from hub.phone.register import Phone, RefusedError

if TYPE_CHECKING:
    from hub.phone.register_file import RegisterFile

MOST_HZ = 60.0
"""Messages a second, on average: twice the pictures of a phone's camera."""
BURST = 60.0
"""Messages at once after a pause."""


@dataclass(slots=True)
class RateLimit:
    """A bucket of tokens: MOST_HZ a second flow in, at most BURST are in it."""

    _tokens: float = BURST
    _at_ns: int | None = None

    def admits(self, now_ns: int) -> bool:
        """Whether one more message may come now."""
        passed_s = 0.0 if self._at_ns is None else max(now_ns - self._at_ns, 0) / SECOND_NS
        self._tokens, self._at_ns = min(BURST, self._tokens + passed_s * MOST_HZ), now_ns
        if self._tokens < 1:
            return False
        self._tokens -= 1
        return True


@dataclass(slots=True)
class Outcome:
    """What a message causes. answers: messages to the phone. line: tracks for the observer. lesson: what is asked."""

    answers: list[Mapping[str, object]] = field(default_factory=list)
    line: bytes | None = None
    lesson: LessonRequest | None = None


@dataclass(slots=True)
class PhoneSession:
    """The state of one connection. phones: who is admitted. scene: its name, for the page. now_ns: our clock (ns)."""

    phones: "RegisterFile"
    scene: str
    now_ns: Callable[[], int]
    phone: Phone | None = None
    camera: CameraState | None = None
    tracks: int = 0
    clock: PhoneClock = field(init=False)
    _rate: RateLimit = field(default_factory=RateLimit)

    def __post_init__(self) -> None:
        self.clock = PhoneClock(self.now_ns)

    def receive(self, text: str | bytes) -> Outcome:
        """Take a message; raises RefusedError and BadPhoneMessage, one line, if the connection must end."""
        if not self._rate.admits(self.now_ns()):
            raise BadPhoneMessage(f"more than {MOST_HZ:g} messages a second")
        message = read_message(text)
        if isinstance(message, Join | Resume):
            return self._admit(message)
        if self.phone is None:
            raise RefusedError("the first message must show a code or a secret")
        match message:
            case ClockAnswer():
                self.clock.answer(message.number, message.now_ms)
            case CameraState():
                self.camera = message
            case LessonRequest():
                return Outcome(lesson=message)
            case PhoneTracks():
                return self._track(message)
        return Outcome()

    def question(self) -> Mapping[str, object]:
        """The next question for the phone's clock."""
        return {"clock": self.clock.ask()}

    def _admit(self, message: Join | Resume) -> Outcome:
        if self.phone is not None:
            raise BadPhoneMessage("this phone is admitted already")
        secret: str | None = None
        if isinstance(message, Join):
            self.phone, secret = self.phones.join(message.code, message.name)
        else:
            self.phone = self.phones.resume(message.secret)
        welcome = {"scene": self.scene, "observer": self.phone.observer, "secret": secret}
        return Outcome([{"welcome": welcome}, self.question()])

    def _track(self, message: PhoneTracks) -> Outcome:
        self.tracks += 1
        outcome = Outcome([{"taken": self.tracks}])
        captured_ns = self.clock.captured_ns(message.at_ms)
        if captured_ns is not None:
            line = {"captured_ns": captured_ns, "parts": message.parts}
            outcome.line = json.dumps(line, separators=(",", ":")).encode()
        return outcome
