"""One phone's WebSocket, without the socket: what its messages cause, and its times as ours. Pure.

1. The first message joins or resumes; anything else before it, and any message that breaks a rule, ends the connection
   with one line.
2. At most MOST_HZ messages a second; the page sends the next tracks only when few are not acknowledged, so that what
   waited on a slow line is never more than that.
3. Tracks go on as a line of another program's tracks (docs/guide/cameras.md), in our time. Those that are too late, or
   no newer than the last ones, are dropped.
4. The skew of the phone's clock is measured as between machines (common/clock_skew.py): we send a numbered question and
   the phone answers with its clock; the answer with the shortest way counts.
5. A page that looks at pictures lets a question wait and answers at once: the way there is longer than the way back.
   How long the line alone takes there and back a ping tells, which the browser answers itself.
6. A picture cannot have been taken after its tracks arrived.
7. The page shows what its observer believes, and what the referee decided.
"""

import json
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from common import MS_NS, SECOND_NS
from common.clock_skew import READINGS_LIMIT, ClockReading, ClockSkew
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
from hub.scene_state import SceneState, is_abstention
from hub.wording import label_words

if TYPE_CHECKING:
    from hub.phone.register_file import RegisterFile

LATE_S = 1.0
"""Older tracks are dropped: half the time after which fusion drops a posterior (fusion.drop_s)."""
QUESTIONS_LIMIT = 16
"""Questions that may wait for an answer; one is sent each second."""


@dataclass(slots=True)
class PhoneClock:
    """now_ns: our clock (Unix epoch, ns). dropped: how many tracks were too late, or no newer than the last."""

    now_ns: Callable[[], int]
    dropped: int = 0
    _skew: ClockSkew = field(default_factory=ClockSkew)
    _asked_ns: dict[int, int] = field(default_factory=dict)
    _lines_ns: deque[int] = field(default_factory=lambda: deque(maxlen=READINGS_LIMIT))
    _number: int = 0
    _newest_ns: int = 0

    def ask(self) -> int:
        """The number of a question that is sent now."""
        self._number += 1
        self._asked_ns[self._number] = self.now_ns()
        if len(self._asked_ns) > QUESTIONS_LIMIT:
            del self._asked_ns[min(self._asked_ns)]
        return self._number

    def answer(self, number: int, phone_ms: float) -> None:
        """The phone's answer to a question; one that was never asked, or was answered, counts nothing."""
        asked_ns = self._asked_ns.pop(number, None)
        now_ns = self.now_ns()
        if asked_ns is not None and now_ns >= asked_ns:
            self._skew.note(ClockReading(asked_ns, round(phone_ms * MS_NS), now_ns))

    def note_line(self, seconds: float) -> None:
        """How long a ping took there and back."""
        self._lines_ns.append(round(seconds * SECOND_NS))

    @property
    def _skew_ns(self) -> int | None:
        """By how much the phone's clock is ahead; None before the first answer."""
        best, least_ns = self._skew.best, self._skew.least_ns
        if best is None or least_ns is None or not self._lines_ns:
            return None if best is None else best.skew_ns
        return min(best.skew_ns, least_ns + min(self._lines_ns) // 2)

    def captured_ns(self, phone_ms: float) -> int | None:
        """When a picture was taken, by our clock (Unix epoch, ns), as its tracks arrive now; None: drop them."""
        skew_ns, now_ns = self._skew_ns, self.now_ns()
        if skew_ns is None:
            self.dropped += 1
            return None
        if self._newest_ns > now_ns:
            self._newest_ns = 0  # our clock was set back
        at_ns = min(round(phone_ms * MS_NS) - skew_ns, now_ns)
        if now_ns - at_ns > LATE_S * SECOND_NS or at_ns <= self._newest_ns:
            self.dropped += 1
            return None
        self._newest_ns = at_ns
        return at_ns


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


def scene_words(state: SceneState, observer: str) -> Mapping[str, object]:
    """The scene as the page of the phone `observer` shows it: an object for JSON, with these keys.

    own, judged: the likeliest movement and its probability, by this observer and by the referee; None without one.
    moves: whether a movement is in progress; why: what it lacks for a verdict. verdict: the newest one, None before.
    known: the movements that are recognised. observer: the state of its process, `silent` without one.
    """
    own = next((each for each in state.observers if each.name == observer), None)
    fused = None if state.silent or not state.fused else state.fused[0]
    verdict, ranked = state.verdict, own.ranked if own is not None and own.is_heard else ()
    return {
        "own": {"label": ranked[0].label, "p": round(ranked[0].p, 2)} if ranked else None,
        "judged": None if fused is None else {"label": fused.label, "p": round(fused.p, 2)},
        "moves": bool(state.judgement and state.judgement.movement),
        "why": (state.judgement.why if state.judgement else None) or "",
        "known": list(state.labels),
        "observer": own.status.state if own is not None and own.status is not None else "silent",
        "verdict": None
        if verdict is None
        else {
            "id": verdict.id,
            "label": "undecided" if is_abstention(verdict) else label_words(verdict),
            "k": verdict.agreement.k,
            "n": verdict.agreement.n,
            "began_ms": verdict.began_ns // MS_NS,
            "ended": verdict.ended_ns is not None,
        },
    }
