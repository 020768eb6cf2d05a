"""Listening to one scene in its own thread, for a loop that talks to a broker: newest state, every verdict.

Judgements arrive as fast as frames; a broker gets a few a second, so only the newest of each look is decoded.
"""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Self, cast

from common.inbox import Arrival
from common.keys import observer_of
from common.messages import VerdictMessage
from hub.scene_state import SceneState
from hub.session import SceneUpdate, listen

if TYPE_CHECKING:
    from common.config import Scene
    from common.link import Link

END_S = 5.0


class _NewestJudgementInbox:
    """An inbox that holds only the newest judgement, and all other messages."""

    def __init__(self, link: "Link", judgement_key: str, other_keys: list[str]) -> None:
        self._judgements, self._others = link.inbox(judgement_key, limit=1), link.inbox(*other_keys)
        self._waiting: list[Arrival] = []
        self.opened = False

    def take(self, timeout_s: float) -> list[Arrival]:
        self.opened = True
        waiting, self._waiting = self._waiting, []
        # A verdict precedes the judgement that shows it.
        return [*waiting, *self._others.take(0.0 if waiting else timeout_s), *self._judgements.take(0.0)]

    def waiting(self) -> set[tuple[str, bytes]]:
        """What has arrived so far; the next `take` returns it first."""
        self._waiting += self._others.take(0.0)
        return {(arrival.key, arrival.payload) for arrival in self._waiting}

    @property
    def dropped(self) -> int:
        return self._others.dropped


class _QuietLink:
    """A link with a _NewestJudgementInbox, whose queries leave out what has also arrived by itself."""

    def __init__(self, link: "Link", judgement_key: str) -> None:
        self._link, self._judgement_key = link, judgement_key
        self.box: _NewestJudgementInbox | None = None

    def inbox(self, *keys: str) -> _NewestJudgementInbox:
        others = [key for key in keys if key != self._judgement_key]
        self.box = _NewestJudgementInbox(self._link, self._judgement_key, others)
        return self.box

    def ask_each(self, key: str, timeout_s: float) -> list[tuple[str, bytes]]:
        answers = self._link.ask_each(key, timeout_s)
        # A verdict published between the opening of the inbox and the query is new.
        waiting = self.box.waiting() if self.box else set()
        return [answer for answer in answers if answer not in waiting]


@dataclass(frozen=True, slots=True)
class ArrivedVerdict:
    """A verdict; `answered`: it is the answer to the query at the start, and may be long past."""

    verdict: VerdictMessage
    answered: bool


class SceneListener:
    """Listens to `scene` while it is entered. `note` is called with every update, in the listening thread.

    state: the newest state. verdicts: those that arrived; the reader empties it.
    """

    def __init__(self, scene: "Scene", link: "Link", note: Callable[[SceneUpdate], None]) -> None:
        self.state = SceneState(scene.scene, scene.roster)
        self.verdicts: deque[ArrivedVerdict] = deque()
        self._fault: Exception | None = None
        self._scene, self._note, self._ended = scene, note, threading.Event()
        self._link = _QuietLink(link, scene.keys.judgement)
        self._presence = link.presence(scene.keys.observer_alive())
        self._thread = threading.Thread(target=self._listen, name=f"listen-{scene.scene}", daemon=True)

    @property
    def tokens(self) -> frozenset[str]:
        """The observers whose processes can be reached."""
        return frozenset(map(observer_of, self._presence.alive))

    @property
    def ready(self) -> bool:
        """Whether the last values have been queried; before that `state` is incomplete."""
        return self._link.box is not None and self._link.box.opened

    @property
    def dropped(self) -> int:
        """Messages that arrived faster than they were read."""
        return self._link.box.dropped if self._link.box else 0

    def check(self) -> None:
        """Raise the exception that ended the thread, if one did."""
        if self._fault is not None:
            raise self._fault

    def _listen(self) -> None:
        try:
            for update in listen(self._scene, cast("Link", self._link), lambda: not self._ended.is_set()):
                self.state = update.state
                if isinstance(update.message, VerdictMessage):
                    self.verdicts.append(ArrivedVerdict(update.message, answered=not self.ready))
                self._note(update)
        except Exception as error:  # noqa: BLE001 - the loop that reads from us raises it
            self._fault = error

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join(END_S)
