"""Listening to one scene in a thread of its own, for a loop that speaks to a broker: newest state, each verdict.

Judgements come as fast as pictures; a broker hears a few a second, so only the newest one of each look is read.
"""

import threading
from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Self, cast

from common.inbox import Arrival
from common.keys import observer_of
from common.messages import VerdictMessage
from hub.scene_state import SceneState
from hub.session import Heard, listen

if TYPE_CHECKING:
    from common.config import Scene
    from common.link import Link

END_S = 5.0


class _NewestJudgement:
    """An inbox that keeps of the judgements the newest only, and all else whole."""

    def __init__(self, link: "Link", judgement: str, others: list[str]) -> None:
        self._judgements, self._others = link.inbox(judgement, limit=1), link.inbox(*others)
        self._held: list[Arrival] = []
        self.opened = False

    def take(self, timeout_s: float) -> list[Arrival]:
        self.opened = True
        held, self._held = self._held, []
        # A verdict is said before the judgement that shows it.
        return [*held, *self._others.take(0.0 if held else timeout_s), *self._judgements.take(0.0)]

    def waiting(self) -> set[tuple[str, bytes]]:
        """What has come since it was opened, and is taken first when it is taken."""
        self._held += self._others.take(0.0)
        return {(arrival.key, arrival.payload) for arrival in self._held}

    @property
    def dropped(self) -> int:
        return self._others.dropped


class _CalmLink:
    """A link whose inbox is calm, and that is told on asking only what did not come by itself meanwhile."""

    def __init__(self, link: "Link", judgement: str) -> None:
        self.ask = link.ask
        self._link, self._judgement = link, judgement
        self.box: _NewestJudgement | None = None

    def inbox(self, *keys: str) -> _NewestJudgement:
        self.box = _NewestJudgement(self._link, self._judgement, [key for key in keys if key != self._judgement])
        return self.box

    def ask_each(self, key: str, timeout_s: float) -> list[tuple[str, bytes]]:
        answers = self._link.ask_each(key, timeout_s)
        # A verdict said between the opening of the inbox and the asking is news, not history.
        waiting = self.box.waiting() if self.box else set()
        return [answer for answer in answers if answer not in waiting]


class Ear:
    """What is heard of `scene`; a context manager that listens while it is entered. `note` is called for all of it.

    `verdicts` are pairs of a verdict and whether it was told on asking, at the beginning; who takes them empties it.
    """

    def __init__(self, scene: "Scene", link: "Link", note: Callable[[Heard], None]) -> None:
        self.state = SceneState(scene.scene, scene.roster)
        self.verdicts: deque[tuple[VerdictMessage, bool]] = deque()
        self._fault: Exception | None = None
        self._scene, self._note, self._ended = scene, note, threading.Event()
        self._link = _CalmLink(link, scene.keys.judgement)
        self._presence = link.presence(scene.keys.observer_alive())
        self._thread = threading.Thread(target=self._listen, name=f"ear-{scene.scene}", daemon=True)

    @property
    def tokens(self) -> frozenset[str]:
        """The observers whose processes can be reached."""
        return frozenset(map(observer_of, self._presence.alive))

    @property
    def listens(self) -> bool:
        """Whether what was said before has been asked for; until then `state` knows less than the mesh."""
        return self._link.box is not None and self._link.box.opened

    @property
    def dropped(self) -> int:
        """Messages that came faster than they were read."""
        return self._link.box.dropped if self._link.box else 0

    def check(self) -> None:
        """Raises what ended the listening before its time."""
        if self._fault is not None:
            raise self._fault

    def _listen(self) -> None:
        try:
            for heard in listen(self._scene, cast("Link", self._link), lambda: not self._ended.is_set()):
                self.state = heard.state
                if isinstance(heard.message, VerdictMessage):
                    self.verdicts.append((heard.message, not self.listens))
                self._note(heard)
        except Exception as error:  # noqa: BLE001 - the loop that waits for us raises it
            self._fault = error

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join(END_S)
