"""Plays a capture back onto a mesh: every message under its key, at its time, with the processes' liveliness.

Sessions:
1. One session publishes everything; each liveliness token has its own session, which closes when its process ended.
2. With fusion's messages the playback takes the place of the fusion service: on one machine it is the endpoint at which
   the others meet. With posteriors alone a fusion service must run, and the playback waits for it.
3. Late joiners can query the last messages, as from the processes themselves, and the vocabulary from the beginning.

Times:
4. An observer's messages keep their age: captured as long before they are sent as in the recording. Messages of one
   session never have equal times, because fusion rejects a clock that stands still.
5. Fusion's messages are shifted by one common offset, so that the messages about a verdict agree on its begin.
6. Sessions get new names, because a replay is a new start of every process. At another speed, time spans scale.
"""

import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from common import SECOND_NS
from common.arrival import APPEARED, CaptureRecord
from common.config import Scene
from common.errors import LabanmeshError
from common.link import Link, Publisher
from common.messages import (
    AnyMessage,
    JudgementMessage,
    OngoingMovement,
    PosteriorMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
)
from common.wire import BadMessage, decode, encode

if TYPE_CHECKING:
    from common.capture_file import CaptureFile

FUSION_TIMEOUT_S = 10.0
HUB_TIMEOUT_S = 1.0
"""How long to wait for a subscriber: a fusion service is required, a hub is not."""
VERDICTS_KEPT = 10
"""Verdicts that a late joiner gets, as from the fusion service."""
QUERYABLE = ("judgement", "verdict", "status", "vocabulary")
MESSAGE_TYPES: dict[str, type[AnyMessage]] = {
    "posterior": PosteriorMessage,
    "status": StatusMessage,
    "judgement": JudgementMessage,
    "verdict": VerdictMessage,
    "vocabulary": VocabularyMessage,
}
"""By the last part of the key."""
SESSION_KEPT = 40
"""Characters of a recorded session id that stay readable in the new one."""


@dataclass(frozen=True, slots=True)
class PlaybackOptions:
    """speed: a factor above 0."""

    speed: float = 1.0
    posteriors_only: bool = False


@dataclass(slots=True)
class TimeShift:
    """New times for a capture that begins at first_ns, played from start_ns on.

    scene: id of the scene onto whose mesh it is played; run: a suffix for the session ids of this playback.
    """

    first_ns: int
    start_ns: int
    speed: float
    scene: str
    run: str
    _newest: dict[str, tuple[int, int]] = field(default_factory=dict)

    def due_ns(self, arrived_ns: int) -> int:
        """When to send a message that arrived at `arrived_ns` (rules 5 and 6)."""
        return self.start_ns + round((arrived_ns - self.first_ns) / self.speed)

    def payload(self, record: CaptureRecord, now_ns: int) -> bytes:
        """The bytes to send at `now_ns`; a message that cannot be decoded is sent unchanged."""
        kind = MESSAGE_TYPES.get(record.key.rsplit("/", 1)[-1])
        try:
            message = None if kind is None else decode(kind, record.payload)
        except BadMessage:
            message = None
        if message is None:
            return record.payload
        fields = {"scene": self.scene} | self._shifted(message, record, now_ns)
        if isinstance(message, PosteriorMessage):
            return encode(message.with_fields(**fields))
        return encode(message.model_copy(update=fields))

    def _shifted(self, message: AnyMessage, record: CaptureRecord, now_ns: int) -> dict[str, Any]:
        match message:
            case PosteriorMessage():
                return self._posterior(message, record.arrived_ns, now_ns)
            case StatusMessage():
                last_ns = message.last_frame_ns
                frame_ns = None if last_ns is None else now_ns - self._scaled(record.arrived_ns - last_ns)
                return {"last_frame_ns": frame_ns, "at_ns": None if message.at_ns is None else now_ns}
            case JudgementMessage():
                return self._judgement(message)
            case _:
                return {}

    def _posterior(self, message: PosteriorMessage, arrived_ns: int, now_ns: int) -> dict[str, Any]:
        name = f"{message.observer} {message.session}"
        last_captured_ns, last_sent_ns = self._newest.get(name, (0, 0))
        captured_ns = max(now_ns - self._scaled(arrived_ns - message.captured_ns), last_captured_ns + 1)
        sent_ns = max(now_ns - self._scaled(arrived_ns - message.sent_ns), last_sent_ns + 1, captured_ns)
        self._newest[name] = captured_ns, sent_ns
        session = f"{message.session[:SESSION_KEPT]}-{self.run}"
        return {"captured_ns": captured_ns, "sent_ns": sent_ns, "session": session}

    def _judgement(self, message: JudgementMessage) -> dict[str, Any]:
        shifted: dict[str, Any] = {"at_ns": self.due_ns(message.at_ns)}
        if message.movement is not None:
            shifted["movement"] = message.movement.model_copy(update=self._movement(message.movement))
        return shifted | self._movement(message) if isinstance(message, VerdictMessage) else shifted

    def _movement(self, movement: OngoingMovement | VerdictMessage) -> dict[str, Any]:
        """The times of a movement, and its id, which contains its begin."""
        times = {name: getattr(movement, name, None) for name in ("began_ns", "decided_ns", "ended_ns")}
        shifted = {name: self.due_ns(at_ns) for name, at_ns in times.items() if at_ns is not None}
        return {**shifted, "id": f"{self.scene}-{shifted['began_ns'] // 1_000_000}"}

    def _scaled(self, span_ns: int) -> int:
        return round(span_ns / self.speed)


@dataclass(slots=True)
class CaptureOutline:
    """What playing needs to know of a capture beforehand: its times, its length, its vocabularies."""

    records: int = 0
    first_ns: int = 0
    vocabularies: dict[str, CaptureRecord] = field(default_factory=dict)

    @classmethod
    def of(cls, capture: "CaptureFile") -> "CaptureOutline":
        """Read the file once; raises LabanmeshError for a capture without messages."""
        outline = cls()
        for record in capture.records():
            outline.first_ns = outline.first_ns or record.arrived_ns
            outline.records += 1
            if record.key.endswith("/vocabulary"):
                outline.vocabularies.setdefault(record.key, record)
        if not outline.records:
            raise LabanmeshError(f"{capture.path}: contains no messages, so there is nothing to play")
        return outline


def play(
    capture: "CaptureFile",
    scene: Scene,
    options: PlaybackOptions,
    stop: threading.Event,
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> int:
    """Publish the capture onto the mesh of `scene` until its end or `stop`; returns the number of messages.

    Raises LabanmeshError when no fusion service subscribes.
    """
    outline = CaptureOutline.of(capture)
    with ExitStack() as links:
        link = links.enter_context(Link.open(scene.mesh, "hub" if options.posteriors_only else "fusion"))
        player = _Player(capture, scene, options, link, links, outline)
        for record in outline.vocabularies.values():
            player.answer(record)
        player.wait_for_subscribers()
        return player.play(stop, progress)


class _Player:
    """The sessions through which a capture is published."""

    def __init__(
        self,
        capture: "CaptureFile",
        scene: Scene,
        options: PlaybackOptions,
        link: Link,
        links: ExitStack,
        outline: CaptureOutline,
    ) -> None:
        self._capture, self._scene, self._options = capture, scene, options
        self._link, self._links, self._outline = link, links, outline
        self._tokens: dict[str, Link] = {}
        self._publishers: dict[str, Publisher] = {}
        self._last: dict[str, deque[CaptureRecord]] = {}
        self._times = self._start()

    def _start(self) -> TimeShift:
        first_ns, speed = self._outline.first_ns, self._options.speed
        return TimeShift(first_ns, time.time_ns(), speed, self._scene.scene, secrets.token_hex(4))

    def wait_for_subscribers(self) -> None:
        """Give subscribers time to connect (rule 2)."""
        keys, mesh = self._scene.keys, self._scene.mesh
        if not self._options.posteriors_only:
            self._publisher(keys.judgement).wait_for_subscriber(HUB_TIMEOUT_S)
        elif not self._publisher(keys.posterior(self._capture.scene.roster[0])).wait_for_subscriber(FUSION_TIMEOUT_S):
            raise LabanmeshError(
                f"mesh.endpoint = {mesh.endpoint!r}: no subscriber to posteriors there; start `labanmesh fuse` first"
            )

    def play(self, stop: threading.Event, progress: Callable[[str, int, int], None]) -> int:
        """Publish all records, each at its time; returns the number of messages."""
        self._times, count = self._start(), 0
        for number, record in enumerate(self._capture.records(), 1):
            if self._options.posteriors_only and not self._is_observers(record):
                continue
            wait_s = (self._times.due_ns(record.arrived_ns) - time.time_ns()) / SECOND_NS
            if stop.wait(wait_s) if wait_s > 0 else stop.is_set():
                break
            count += self._publish(record)
            progress("playing", number, self._outline.records)
        return count

    def _is_observers(self, record: CaptureRecord) -> bool:
        """Whether the record is a posterior or a liveliness token of an observer."""
        if not record.key.startswith(f"{self._capture.scene.keys.root}/observer/"):
            return False
        return record.kind == "token" or (record.kind == "put" and record.key.endswith("/posterior"))

    def _publish(self, record: CaptureRecord) -> bool:
        if record.kind == "token":
            self._set_token(record)
        else:
            self.answer(record)
        if record.kind == "put":
            self._publisher(self._key(record)).put(self._payload(record))
        return record.kind == "put"

    def answer(self, record: CaptureRecord) -> None:
        """Answer queries for this key with this record from now on (rule 3)."""
        key = self._key(record)
        if key.rsplit("/", 1)[-1] not in QUERYABLE:
            return
        if key not in self._last:
            self._last[key] = deque(maxlen=VERDICTS_KEPT if key == self._scene.keys.verdict else 1)
            # A status gets its time when it is queried: fusion reads the clock skew from it.
            self._link.answer(key, lambda: [self._payload(last) for last in tuple(self._last[key])])
        self._last[key].append(record)

    def _set_token(self, record: CaptureRecord) -> None:
        key = self._key(record)
        if (gone := self._tokens.pop(key, None)) is not None:
            gone.close()
        if record.payload == APPEARED:
            self._tokens[key] = self._links.enter_context(Link.open(self._scene.mesh, "hub"))
            self._tokens[key].announce(key)

    def _key(self, record: CaptureRecord) -> str:
        return self._scene.keys.root + record.key.removeprefix(self._capture.scene.keys.root)

    def _payload(self, record: CaptureRecord) -> bytes:
        return self._times.payload(record, time.time_ns())

    def _publisher(self, key: str) -> Publisher:
        if key not in self._publishers:
            self._publishers[key] = self._link.publisher(key)
        return self._publishers[key]
