"""The browsers that look on: each with an outbox of its own, so that a slow one holds up nobody."""

import asyncio
from collections.abc import AsyncIterator, Callable

from hub.dashboard.chronicle import Chronicle
from hub.dashboard.events import event
from hub.dashboard.outbox import Outbox
from hub.dashboard.picture import Hall, snapshot

BROWSERS_LIMIT = 256


class Audience:
    """All browsers of one dashboard; lives in one event loop, `tell` may be called from another thread."""

    def __init__(self, hall: Hall, first: Chronicle, loop: asyncio.AbstractEventLoop) -> None:
        self._hall, self._chronicle, self._loop = hall, first, loop
        self._snapshot: tuple[Chronicle, bytes] | None = None
        self._browsers: dict[Outbox, asyncio.Event] = {}
        self._closed = False
        self.told: Callable[[], None] = lambda: None
        """Called in the event loop after each word: both threads do their work."""

    def __len__(self) -> int:
        return len(self._browsers)

    @property
    def is_full(self) -> bool:
        """Whether nobody more is let in."""
        return len(self._browsers) >= BROWSERS_LIMIT

    def tell(self, chronicle: Chronicle, verdict: bytes | None = None, state: bytes | None = None) -> None:
        """What is known now, and the events that say what is new in it; returns at once."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._pass_on, chronicle, verdict, state)

    def close(self) -> None:
        """Let all browsers go."""
        self._closed = True
        for wake in self._browsers.values():
            wake.set()

    async def stream(self) -> AsyncIterator[bytes]:
        """What one browser is sent, a snapshot first, until it goes or the audience is closed."""
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

    def _pass_on(self, chronicle: Chronicle, verdict: bytes | None, state: bytes | None) -> None:
        self._chronicle = chronicle
        for outbox, wake in self._browsers.items():
            if verdict is not None:
                outbox.verdict(verdict)
            if state is not None:
                outbox.state(state)
            wake.set()
        self.told()

    def _whole(self) -> bytes:
        """The snapshot of now; many browsers that come at once share one."""
        if self._snapshot is None or self._snapshot[0] is not self._chronicle:
            self._snapshot = self._chronicle, event("snapshot", snapshot(self._hall, self._chronicle))
        return self._snapshot[1]
