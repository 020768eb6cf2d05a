"""Listening to one scene in its own thread, for a loop that talks to a broker: newest state, every verdict."""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from common.keys import observer_of
from common.messages import VerdictMessage
from hub.scene_state import SceneState
from hub.session import SceneUpdate, listen

if TYPE_CHECKING:
    from common.config import Scene
    from common.link import Link

END_S = 5.0


@dataclass(frozen=True, slots=True)
class ArrivedVerdict:
    """A verdict; `answered`: it is the answer to the query at the start, and may be long past."""

    verdict: VerdictMessage
    answered: bool


class SceneListener:
    """Listens to `scene` while it is entered. `note` is called with every update, in the listening thread.

    state: the newest state. ready: whether the last values have been queried; before that `state` is incomplete.
    verdicts: those that arrived; the reader empties it.
    """

    def __init__(self, scene: "Scene", link: "Link", note: Callable[[SceneUpdate], None]) -> None:
        self.state = SceneState(scene.scene, scene.roster)
        self.ready = False
        self.verdicts: deque[ArrivedVerdict] = deque()
        self._fault: Exception | None = None
        self._scene, self._link, self._note, self._ended = scene, link, note, threading.Event()
        self._presence = link.presence(scene.keys.observer_alive())
        self._thread = threading.Thread(target=self._listen, name=f"listen-{scene.scene}", daemon=True)

    @property
    def tokens(self) -> frozenset[str]:
        """The observers whose processes can be reached."""
        return frozenset(map(observer_of, self._presence.alive))

    def check(self) -> None:
        """Raise the exception that ended the thread, if one did."""
        if self._fault is not None:
            raise self._fault

    def _listen(self) -> None:
        try:
            for update in listen(self._scene, self._link, lambda: not self._ended.is_set(), newest_only=True):
                self.state = update.state
                if isinstance(update.message, VerdictMessage):
                    self.verdicts.append(ArrivedVerdict(update.message, update.answered))
                self.ready = self.ready or not update.answered
                self._note(update)
        except Exception as error:  # noqa: BLE001 - the loop that reads from us raises it
            self._fault = error

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join(END_S)
