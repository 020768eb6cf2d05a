"""A teacher's requests to all observers of a scene at once, and their replies."""

import threading
import time
from collections.abc import Collection

from common.config import Scene
from common.inbox import Presence
from common.keys import SceneKeys, observer_of
from common.link import Link
from common.subsession import SubSession
from common.teaching_messages import TeachReply, TeachRequest
from common.wire import BadMessage, decode, encode
from hub.teaching.interface import Answers

OBSERVER_ANSWER_S = 2.0
"""An observer answers within milliseconds, between two frames; one that learns or writes, a little later."""
ATTEMPTS = 3
FIND_S, FIND_LOOK_S = 3.0, 0.1
"""Observers that run are found within milliseconds; meanwhile Ctrl-C is looked for that often."""


class TeachingClient:
    """Asks observers under their own exact keys. answer_s: how long it waits for answers; attempts: how often."""

    def __init__(
        self, link: SubSession, keys: SceneKeys, answer_s: float = OBSERVER_ANSWER_S, attempts: int = ATTEMPTS
    ) -> None:
        self._link, self._keys, self._answer_s, self._attempts = link, keys, answer_s, attempts

    def ask(self, request: TeachRequest, observers: Collection[str]) -> Answers:
        """Ask all these observers at once; one that does not answer is asked again, since requests may be repeated."""
        replies: dict[str, TeachReply] = {}
        for _ in range(self._attempts):
            missing = [name for name in observers if name not in replies]
            if not missing:
                break
            replies |= self._ask_once(encode(request), missing)
        silent = tuple(name for name in observers if name not in replies)
        return Answers({name: replies[name] for name in observers if name in replies}, silent)

    def _ask_once(self, payload: bytes, observers: Collection[str]) -> dict[str, TeachReply]:
        replies: dict[str, TeachReply] = {}
        finished = threading.Semaphore(0)

        def answered(key: str, content: bytes) -> None:
            # A reply does not name its observer: it is of the one whose key it came under.
            observer = observer_of(key)
            if observer not in observers or key != self._keys.teach(observer):
                return
            try:
                replies[observer] = decode(TeachReply, content)
            except BadMessage:
                return

        for name in observers:
            self._link.request(self._keys.teach(name), answered, self._answer_s, finished.release, payload)
        for _ in observers:
            finished.acquire(timeout=2 * self._answer_s)
        return dict(replies)


def find_observers(scene: Scene, link: Link, stop: threading.Event) -> Presence:
    """Which observers of the scene file are alive; one that is missing is waited for, at most FIND_S.

    Raises KeyboardInterrupt as soon as `stop` is set.
    """
    presence = presence_of(scene, link)
    end_s = time.monotonic() + FIND_S
    while not presence.wait_for(len(scene.roster), FIND_LOOK_S) and time.monotonic() < end_s:
        if stop.is_set():
            raise KeyboardInterrupt
    return presence


def presence_of(scene: Scene, link: Link) -> Presence:
    """The observers of the scene file that are alive, kept up to date."""
    return link.presence(scene.keys.observer_alive(), map(scene.keys.observer_alive, scene.roster))


def names_of(presence: Presence, scene: Scene) -> list[str]:
    """The observers of the scene file that are alive, in its order."""
    names = {observer_of(key) for key in presence.alive}
    return [name for name in scene.roster if name in names]
