"""Live pictures for browsers: an observer is subscribed to only while a browser asks for its pictures.

1. A browser asks again and again for the newest picture; the subscription ends VIEWER_LEASE_S after the last request.
2. Nothing is kept but the newest picture of each observer that somebody watches.
"""

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from common.inbox import Inbox
from common.keys import SceneKeys
from common.link import Link
from common.picture_message import PictureMessage
from common.subsession import SubSession
from common.wire import BadMessage, decode

VIEWER_LEASE_S = 3.0
JPEG_START = b"\xff\xd8"
PictureState = Literal["picture", "none yet", "switched off", "no right"]


@dataclass(frozen=True, slots=True)
class PictureAnswer:
    """The newest picture of an observer, or why there is none. captured_ns: identifies it."""

    state: PictureState
    captured_ns: int = 0
    jpeg: bytes = b""


@dataclass(slots=True)
class _Watched:
    declared: SubSession
    inbox: Inbox
    asked_s: float
    newest: PictureAnswer = field(default_factory=lambda: PictureAnswer("none yet"))


class PictureRelay:
    """The live pictures of a scene; safe to use from several threads.

    switched_on: the observers whose section sets `picture_hz`. has_right: whether this process's certificate allows it.
    """

    def __init__(
        self,
        keys: SceneKeys,
        switched_on: Mapping[str, float],
        link: Link,
        has_right: bool,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._keys, self._switched_on, self._link = keys, switched_on, link
        self._has_right, self._clock = has_right, clock
        self._watched: dict[str, _Watched] = {}
        self._lock = threading.Lock()

    def newest(self, observer: str) -> PictureAnswer:
        """The newest picture of `observer`, which is subscribed to from now on."""
        if observer not in self._switched_on:
            return PictureAnswer("switched off")
        if not self._has_right:
            return PictureAnswer("no right")
        with self._lock:
            watched = self._watched.get(observer) or self._watch(observer)
            watched.asked_s = self._clock()
            for arrival in watched.inbox.take(0.0):
                watched.newest = _read(arrival.payload) or watched.newest
            return watched.newest

    def end_unwatched(self) -> None:
        """End the subscriptions that no browser has asked for; to be called now and then."""
        with self._lock:
            now_s = self._clock()
            for observer in [name for name, each in self._watched.items() if now_s - each.asked_s > VIEWER_LEASE_S]:
                self._watched.pop(observer).declared.close()

    def _watch(self, observer: str) -> _Watched:
        declared = self._link.sub_session()
        watched = _Watched(declared, declared.inbox(self._keys.picture(observer), limit=1), self._clock())
        self._watched[observer] = watched
        return watched


def _read(payload: bytes) -> PictureAnswer | None:
    try:
        message = decode(PictureMessage, payload)
    except BadMessage:
        return None
    if not message.jpeg.startswith(JPEG_START):
        return None
    return PictureAnswer("picture", message.captured_ns, message.jpeg)
