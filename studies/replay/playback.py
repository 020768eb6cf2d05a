"""Plays a capture back onto a mesh: every message under its key, at its time."""

import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from common.capture_file import APPEARED, CaptureRecord
from common.errors import BadInput, LabanmeshError
from common.link import Link, Publisher
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

if TYPE_CHECKING:
    from common.capture_file import CaptureFile
    from common.config import Scene

LISTENER_S = 10.0
AUDIENCE_S = 1.0
"""How long is waited for somebody to listen: a referee must, an audience may."""
BREATH = 64
BREATH_S = 0.001
"""As fast as possible is so many messages at once: what floods Zenoh is dropped by it."""
VERDICTS_KEPT = 10
"""So many of the last verdicts are told to who comes late, as by the referee."""
ANSWERED = ("judgement", "verdict", "status", "vocabulary")


@dataclass(frozen=True, slots=True)
class Manner:
    """How to play: speed (0: as fast as possible), posteriors alone or everything, the very bytes or moved to now."""

    speed: float = 1.0
    posteriors_only: bool = False
    as_recorded: bool = False


@dataclass(slots=True)
class Outline:
    """What must be known of a capture before it is played: its times, how much it is, and its vocabularies."""

    records: int = 0
    first_ns: int = 0
    last_ns: int = 0
    vocabularies: dict[str, CaptureRecord] = field(default_factory=dict)

    @classmethod
    def of(cls, capture: "CaptureFile") -> "Outline":
        """One look through the file; raises LabanmeshError for one in which nothing was heard."""
        found = cls()
        for record in capture.records():
            found.first_ns = found.first_ns or record.arrived_ns
            found.last_ns = max(found.last_ns, record.arrived_ns)
            found.records += 1
            if record.key.endswith("/vocabulary"):
                found.vocabularies.setdefault(record.key, record)
        if not found.records:
            raise LabanmeshError(f"{capture.path}: nothing was heard in it, so that there is nothing to play")
        return found


def play(
    capture: "CaptureFile",
    scene: "Scene",
    manner: Manner,
    stop: threading.Event,
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> int:
    """Say the capture onto the mesh of `scene` until its end or `stop`; returns how many messages were said.

    Raises BadInput for another scene's messages that may not be changed, LabanmeshError when no referee listens.
    """
    if manner.as_recorded and scene.scene != capture.scene.scene:
        raise BadInput(
            f"--as-recorded: the messages say scene {capture.scene.scene!r}, {scene.scene!r} would refuse them; leave "
            "--as-recorded out or name a scene file of that scene"
        )
    outline = Outline.of(capture)
    with ExitStack() as open_links:
        mouth = open_links.enter_context(Link.open(scene.mesh, "hub" if manner.posteriors_only else "fusion"))
        stage = _Stage(capture, scene, manner, mouth, open_links, outline)
        for record in outline.vocabularies.values():
            stage.answer(record)
        stage.wait_for_listeners()
        return stage.play(stop, progress)


class _Stage:
    """The sessions through which a capture is said."""

    def __init__(
        self, capture: "CaptureFile", scene: "Scene", manner: Manner, mouth: Link, links: ExitStack, outline: Outline
    ) -> None:
        self._capture, self._scene, self._manner, self._mouth, self._outline = capture, scene, manner, mouth, outline
        self._links = links
        self._tokens: dict[str, Link] = {}
        self._publishers: dict[str, Publisher] = {}
        self._last: dict[str, deque[CaptureRecord]] = {}
        self._times = self._begin()

    def _begin(self) -> "MovedTimes":
        outline = self._outline
        run = secrets.token_hex(4)
        first_ns, last_ns, now_ns = outline.first_ns, outline.last_ns, time.time_ns()
        return MovedTimes(first_ns, last_ns, now_ns, self._manner.speed, self._scene.scene, run)

    def wait_for_listeners(self) -> None:
        """Give those who listen time to be found."""
        keys, mesh = self._scene.keys, self._scene.mesh
        if not self._manner.posteriors_only:
            self._publisher(keys.judgement).wait_for_subscriber(AUDIENCE_S)
        elif not self._publisher(keys.posterior(self._capture.scene.roster[0])).wait_for_subscriber(LISTENER_S):
            raise LabanmeshError(
                f"mesh.endpoint = {mesh.endpoint!r}: nobody there listens to posteriors; start `labanmesh fuse` first"
            )

    def play(self, stop: threading.Event, progress: Callable[[str, int, int], None]) -> int:
        """All of it, at its time."""
        self._times, said = self._begin(), 0
        for number, record in enumerate(self._capture.records(), 1):
            if self._manner.posteriors_only and not self._is_an_observers(record):
                continue
            wait_s = (self._times.due_ns(record.arrived_ns) - time.time_ns()) / 1e9
            if not self._manner.speed:
                wait_s = 0 if number % BREATH else BREATH_S
            if stop.wait(wait_s) if wait_s > 0 else stop.is_set():
                break
            said += self._say(record)
            progress("playing", number, self._outline.records)
        return said

    def _is_an_observers(self, record: CaptureRecord) -> bool:
        what = record.key.rsplit("/", 1)[-1]
        below = record.key.startswith(f"{self._capture.scene.keys.root}/observer/")
        return below and (record.kind == "token" or (record.kind == "put" and what == "posterior"))

    def _say(self, record: CaptureRecord) -> bool:
        if record.kind == "token":
            self._show(record)
        else:
            self.answer(record)
        if record.kind == "put":
            self._publisher(self._key(record)).put(self._payload(record))
        return record.kind == "put"

    def answer(self, record: CaptureRecord) -> None:
        """From now on who asks gets this."""
        key = self._key(record)
        if key.rsplit("/", 1)[-1] not in ANSWERED:
            return
        if key not in self._last:
            self._last[key] = deque(maxlen=VERDICTS_KEPT if key == self._scene.keys.verdict else 1)
            # A status is dated when it is asked for: the referee learns from it what the clocks show.
            self._mouth.answer(key, lambda: [self._payload(last) for last in tuple(self._last[key])])
        self._last[key].append(record)

    def _show(self, record: CaptureRecord) -> None:
        key = self._key(record)
        if (gone := self._tokens.pop(key, None)) is not None:
            gone.close()
        if record.payload == APPEARED:
            self._tokens[key] = self._links.enter_context(Link.open(self._scene.mesh, "hub"))
            self._tokens[key].announce(key)

    def _key(self, record: CaptureRecord) -> str:
        return self._scene.keys.root + record.key.removeprefix(self._capture.scene.keys.root)

    def _payload(self, record: CaptureRecord) -> bytes:
        return record.payload if self._manner.as_recorded else self._times.payload(record, time.time_ns())

    def _publisher(self, key: str) -> Publisher:
        if key not in self._publishers:
            self._publishers[key] = self._mouth.publisher(key)
        return self._publishers[key]


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
