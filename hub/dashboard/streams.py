"""Server-sent events to browsers: the live scene for all of them, and a capture played to each of them.

1. Each browser has an outbox, so that a slow one does not delay the others.
2. Of states only the newest waits; verdicts all wait, in order.
3. When too many verdicts wait, none is dropped silently: the browser is behind, and gets a whole snapshot instead.
4. Each browser has its own playhead in a capture.
"""

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from sse_starlette import ServerSentEvent

from common import SECOND_NS
from hub.dashboard.history import CaptureTimeline, SceneHistory
from hub.dashboard.page_data import PageSetup, snapshot_data, state_data, verdict_data

OUTBOX_LIMIT = 32
BROWSERS_LIMIT = 256
STEP_S = 0.1

EventKind = Literal["snapshot", "state", "verdict", "end"]


def event(kind: EventKind, fields: Mapping[str, object]) -> bytes:
    """One server-sent event, JSON without NaN, which browsers cannot read."""
    text = json.dumps(fields, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return ServerSentEvent(text, event=kind, sep="\n").encode()


class Outbox:
    """The queue of one browser. It starts as outdated, so that the browser first gets a snapshot."""

    def __init__(self, limit: int = OUTBOX_LIMIT) -> None:
        self._limit = limit
        self._state: bytes | None = None
        self._verdicts: list[bytes] = []
        self._behind = True

    def put_state(self, payload: bytes) -> None:
        """Replace the waiting state."""
        if not self._behind:
            self._state = payload

    def put_verdict(self, payload: bytes) -> None:
        """Append a verdict."""
        if self._behind:
            return
        if len(self._verdicts) == self._limit:
            self._state, self._behind = None, True
            self._verdicts.clear()
        else:
            self._verdicts.append(payload)

    def take(self, snapshot: Callable[[], bytes]) -> list[bytes]:
        """All that waits, verdicts first, or a snapshot made now; may be empty."""
        if self._behind:
            self._behind = False
            return [snapshot()]
        waiting = [*self._verdicts, *([] if self._state is None else [self._state])]
        self._state = None
        self._verdicts.clear()
        return waiting


class LiveStream:
    """The live scene for all browsers. Lives in one event loop; `publish` may be called from another thread.

    published: called in the event loop after each publication, as a sign that both threads work.
    """

    def __init__(self, setup: PageSetup, first: SceneHistory, published: Callable[[], None]) -> None:
        self._setup, self._history, self._published = setup, first, published
        self._loop = asyncio.get_running_loop()
        self._snapshot: tuple[SceneHistory, bytes] | None = None
        self._browsers: dict[Outbox, asyncio.Event] = {}
        self._closed = False

    @property
    def is_full(self) -> bool:
        """Whether no more browsers are admitted."""
        return len(self._browsers) >= BROWSERS_LIMIT

    def publish(self, history: SceneHistory, verdict: bytes | None = None, state: bytes | None = None) -> None:
        """Take the newest state, and send browsers a verdict and the state, both as JSON; returns at once."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._distribute, history, verdict, state)

    def close(self) -> None:
        """End all streams."""
        self._closed = True
        for wake in self._browsers.values():
            wake.set()

    async def browser(self) -> AsyncIterator[bytes]:
        """The events of one browser, a snapshot first, until it disconnects or the stream is closed."""
        outbox, wake = Outbox(), asyncio.Event()
        self._browsers[outbox] = wake
        wake.set()
        try:
            while not self._closed:
                await wake.wait()
                wake.clear()
                for payload in outbox.take(self._whole):
                    yield payload
        finally:
            del self._browsers[outbox]

    def _distribute(self, history: SceneHistory, verdict: bytes | None, state: bytes | None) -> None:
        self._history = history
        for outbox, wake in self._browsers.items():
            if verdict is not None:
                outbox.put_verdict(verdict)
            if state is not None:
                outbox.put_state(state)
            wake.set()
        self._published()

    def _whole(self) -> bytes:
        """The snapshot of now; browsers that connect at the same time share one."""
        if self._snapshot is None or self._snapshot[0] is not self._history:
            self._snapshot = self._history, event("snapshot", snapshot_data(self._setup, self._history))
        return self._snapshot[1]


@dataclass(frozen=True, slots=True)
class Playhead:
    """Where a capture starts to play, in seconds from its beginning, and how fast; speed 0 stands still."""

    at_s: float = 0.0
    speed: float = 1.0


async def play(
    timeline: CaptureTimeline, setup: PageSetup, head: Playhead, closed: asyncio.Event
) -> AsyncIterator[bytes]:
    """The events of one browser: a snapshot of the playhead's moment, what follows, and `end` at the capture's end.

    They stop when the browser disconnects or `closed` is set.
    """
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    at_ns = _moment(timeline, head.at_s)
    whole = snapshot_data(setup, timeline.history(at_ns, with_minute=True))
    yield event("snapshot", {**whole, "head": _head_s(timeline, at_ns), "marks": timeline.marks})
    while head.speed > 0 and at_ns < timeline.ended_ns and not closed.is_set():
        await asyncio.sleep(STEP_S)
        before_ns, at_ns = at_ns, _moment(timeline, head.at_s + (loop.time() - began_s) * head.speed)
        history = timeline.history(at_ns)
        for verdict in timeline.verdicts_between(before_ns, at_ns):
            yield event("verdict", verdict_data(verdict, history, setup.quorum))
        yield event("state", {**state_data(history), "head": _head_s(timeline, at_ns)})
    if head.speed > 0 and at_ns >= timeline.ended_ns:
        yield event("end", {"head": _head_s(timeline, at_ns)})
    await closed.wait()


def _moment(timeline: CaptureTimeline, at_s: float) -> int:
    return min(timeline.ended_ns, timeline.began_ns + int(at_s * SECOND_NS))


def _head_s(timeline: CaptureTimeline, at_ns: int) -> float:
    return round((at_ns - timeline.began_ns) / SECOND_NS, 2)
