"""A second process with this fusion service's id: at the start, and while both run. twins.py decides."""

import logging
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress

from common.config import Scene
from common.errors import LabanmeshError
from common.keys import SceneKeys
from common.link import Link
from common.message_types import SAME_ID_REASON
from common.messages import JudgementMessage, StatusMessage
from common.subsession import SubSession
from common.wire import BadMessage, decode_from
from fusion.twins import ANSWERS, ASK_EVERY_S, Stance, Twins

log = logging.getLogger("labanmesh.fusion")
LIVING = ("starting", "running", "degraded")
SETTLE_S = 0.15
"""After opening a link it takes at most this long to know whether a service of the same id is alive."""
TOKEN_TIMEOUT_S = 2.5
"""The token of a service that was killed outlives it by its lease, at most 2 s."""


class SameIdError(LabanmeshError):
    """Another fusion service of the same id is alive in the scene."""

    def __init__(self, key: str) -> None:
        super().__init__(
            f"{key}: a fusion service of this id is alive already; stop it, or give this one an id of its own: "
            '[fusion] standby = ["second"] in the scene file, and labanmesh fuse SCENE --id second'
        )


def id_is_free(scenes: Sequence[Scene], own: str, link: Link, stop: threading.Event) -> bool:
    """Wait for a killed process of the same id to disappear; False when stopped before.

    Raises SameIdError when a process of this id answers. A token of which nobody answers keeps no service away.
    """
    keys = scenes[0].keys
    alive, twins = keys.fusion_alive(own), Twins("", float("-inf"), 0.0)
    with link.sub_session() as session:
        # One scene suffices: a process announces itself in all of its scenes.
        presence, asked = session.presence(alive), _Questions(session, keys, own, twins)
        begun_s = time.monotonic()
        while (waited_s := time.monotonic() - begun_s) < SETTLE_S or alive in presence.alive:
            if stop.wait(0.02):
                return False
            now_s = time.monotonic()
            if alive in presence.alive:
                asked.ask(now_s)
            if twins.any_confirmed(now_s):
                raise SameIdError(alive)
            if waited_s > TOKEN_TIMEOUT_S:
                log.warning("%s: somebody holds this token, and nobody answers for it", alive)
                break
    return True


class TwinWatch:
    """What a running service does about other processes of its id in one scene."""

    def __init__(self, session: SubSession, keys: SceneKeys, own: str, twins: Twins) -> None:
        """session: in which to ask and listen; it is polled elsewhere."""
        self._alive, self._key, self._twins = keys.fusion_alive(own), keys.fusion_status(own), twins
        self._statuses = session.inbox(self._key, limit=16, remote=True)
        self._asked = _Questions(session, keys, own, twins)
        self.stance = Stance.GO_ON

    def heard(self, message: JudgementMessage, now_s: float) -> bool:
        """A judgement under this service's id; whether it is of another process that lives."""
        self._twins.heard(message.session, now_s, message.epoch or 0)
        return self._twins.confirmed(message.session, now_s)

    def update(self, epoch: int | None, now_s: float) -> bool:
        """Follow the rules of twins.py; returns whether another process of this id lives.

        epoch: as in Twins.stance. Raises SameIdError in the process that is to end.
        """
        for arrival in self._statuses.take(0):
            with suppress(BadMessage):
                status = decode_from(arrival.key, StatusMessage, arrival.payload)
                if status.state in LIVING:
                    self._twins.heard(status.session, now_s)
        if self.stance is Stance.GO_ON and not self._twins.has_suspects and not self._asked.has_answers:
            return False
        self._asked.ask(now_s, always=False)
        stance, self.stance = self.stance, self._twins.stance(epoch, now_s)
        if self.stance is Stance.END:
            raise SameIdError(self._alive)
        if Stance.STAND_BY in (stance, self.stance) and stance is not self.stance:
            log.warning("%s: %s: %s", self._alive, SAME_ID_REASON, self.stance.value)
        return self._twins.any_confirmed(now_s)


class _Questions:
    """Questions for the status under this service's own key, and the answers of living processes."""

    def __init__(self, session: SubSession, keys: SceneKeys, own: str, twins: Twins) -> None:
        self._session, self._key, self._twins = session, keys.fusion_status(own), twins
        self._answers: deque[tuple[int, bytes]] = deque(maxlen=64)

    @property
    def has_answers(self) -> bool:
        """Whether answers wait."""
        return bool(self._answers)

    def ask(self, now_s: float, *, always: bool = True) -> None:
        """Take what has been answered; ask again if it is due. always: also where nobody is suspected."""
        while self._answers:
            answered, payload = self._answers.popleft()
            with suppress(BadMessage):
                status = decode_from(self._key, StatusMessage, payload)
                if status.state in LIVING:
                    if always:
                        self._twins.heard(status.session, now_s)
                    self._twins.answered(status.session, answered, now_s)
        if (number := self._twins.question(now_s, always=always)) is not None:
            timeout_s = ANSWERS * ASK_EVERY_S
            self._session.request(self._key, lambda _, payload: self._answers.append((number, payload)), timeout_s)
