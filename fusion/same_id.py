"""Notices a second process with this fusion service's id, at the start and while both run.

The decisions are those of same_id_detection.py.
"""

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
from fusion.same_id_detection import ANSWERS, ASK_EVERY_S, SameIdDetector, Stance

log = logging.getLogger("labanmesh.fusion")
RUNNING = ("starting", "running", "degraded")
"""States in which a process that answers is not about to end."""
DISCOVERY_S = 0.15
"""After a link has opened, the liveliness tokens of other processes are known after at most so long."""
TOKEN_TIMEOUT_S = 2.5
"""The token of a killed service outlives it by its lease, at most 2 s."""


class SameIdError(LabanmeshError):
    """Another fusion service of the same id is alive in the scene."""

    def __init__(self, key: str) -> None:
        super().__init__(
            f"{key}: a fusion service of this id is alive already; stop it, or give this one an id of its own: "
            '[fusion] standby = ["second"] in the scene file, and labanmesh fuse SCENE --id second'
        )


class IdCheck:
    """Whether a process that starts is the only one with the id `own`. It begins when it is made: what takes a while
    can be done before `is_free`.
    """

    def __init__(self, scenes: Sequence[Scene], own: str, link: Link) -> None:
        # One scene suffices: a process announces itself in all of its scenes.
        keys = scenes[0].keys
        self._alive, self._detector = keys.fusion_alive(own), SameIdDetector("", float("-inf"), 0.0)
        self._session = link.sub_session()
        self._presence = self._session.presence(self._alive)
        self._questions = _Questions(self._session, keys, own, self._detector)
        self._begun_s = time.monotonic()

    def is_free(self, stop: threading.Event) -> bool:
        """Wait until no other process has the id; False if `stop` was set before.

        The token of a killed process disappears within TOKEN_TIMEOUT_S. A token for which no process answers keeps no
        service away. Raises SameIdError when a process with this id answers.
        """
        with self._session:
            while (waited_s := time.monotonic() - self._begun_s) < DISCOVERY_S or self._alive in self._presence.alive:
                if stop.wait(0.02):
                    return False
                now_s = time.monotonic()
                if self._alive in self._presence.alive:
                    self._questions.ask(now_s)
                if self._detector.any_confirmed(now_s):
                    raise SameIdError(self._alive)
                if waited_s > TOKEN_TIMEOUT_S:
                    log.warning("%s: a token of this id exists, but no process answers for it", self._alive)
                    break
        return True


class SameIdWatch:
    """Watches for other processes with the id of a running service in one scene."""

    def __init__(self, session: SubSession, keys: SceneKeys, own: str, detector: SameIdDetector) -> None:
        """session: in which to ask and listen; it is polled elsewhere."""
        self._alive, self._key, self._detector = keys.fusion_alive(own), keys.fusion_status(own), detector
        self._statuses = session.inbox(self._key, limit=16, remote=True)
        self._questions = _Questions(session, keys, own, detector)
        self.stance = Stance.GO_ON

    def record_judgement(self, message: JudgementMessage, now_s: float) -> bool:
        """Take a judgement under this service's id; returns whether it is from another process that runs."""
        self._detector.record_message(message.session, now_s, message.epoch or 0)
        return self._detector.is_confirmed(message.session, now_s)

    def update(self, epoch: int | None, now_s: float) -> bool:
        """Follow the rules of same_id_detection.py; returns whether another process with this id runs.

        epoch: as in SameIdDetector.stance. Raises SameIdError in the process that is to end.
        """
        for arrival in self._statuses.take(0):
            with suppress(BadMessage):
                status = decode_from(arrival.key, StatusMessage, arrival.payload)
                if status.state in RUNNING:
                    self._detector.record_message(status.session, now_s)
        if self.stance is Stance.GO_ON and not self._detector.has_suspects and not self._questions.has_answers:
            return False
        self._questions.ask(now_s, always=False)
        stance, self.stance = self.stance, self._detector.stance(epoch, now_s)
        if self.stance is Stance.END:
            raise SameIdError(self._alive)
        if Stance.STAND_BY in (stance, self.stance) and stance is not self.stance:
            log.warning("%s: %s: %s", self._alive, SAME_ID_REASON, self.stance.value)
        return self._detector.any_confirmed(now_s)


class _Questions:
    """Requests for the status under this service's own key, and the answers of running processes."""

    def __init__(self, session: SubSession, keys: SceneKeys, own: str, detector: SameIdDetector) -> None:
        self._session, self._key, self._detector = session, keys.fusion_status(own), detector
        self._answers: deque[tuple[int, bytes]] = deque(maxlen=64)

    @property
    def has_answers(self) -> bool:
        """Whether answers have arrived that were not taken yet."""
        return bool(self._answers)

    def ask(self, now_s: float, *, always: bool = True) -> None:
        """Take the answers that have arrived; ask again if it is due. always: also if no session is suspected."""
        while self._answers:
            question, payload = self._answers.popleft()
            with suppress(BadMessage):
                status = decode_from(self._key, StatusMessage, payload)
                if status.state in RUNNING:
                    if always:
                        self._detector.record_message(status.session, now_s)
                    self._detector.record_answer(status.session, question, now_s)
        if (number := self._detector.next_question(now_s, always=always)) is not None:
            timeout_s = ANSWERS * ASK_EVERY_S
            self._session.request(self._key, lambda _, payload: self._answers.append((number, payload)), timeout_s)
