"""Notices a second process with this fusion service's id, at the start and while both run, and which gives way.

The design: fusion.md, "Several services". SameIdDetector decides, and is pure; the others ask and listen.

Of two processes the one that stands by gives way to the one that publishes, then the one with the lower epoch, then the
one with the lower session: both decide on the same one. Times are seconds of a monotonic clock.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum

from common.config import Scene
from common.errors import LabanmeshError
from common.keys import SceneKeys
from common.link import Link
from common.message_types import SAME_ID_REASON
from common.messages import JudgementMessage, StatusMessage
from common.subsession import SubSession
from common.wire import BadMessage, decode_from

log = logging.getLogger("labanmesh.fusion")
RUNNING = ("starting", "running", "degraded")
"""States in which a process that answers is not about to end."""
DISCOVERY_S = 0.15
"""After a link has opened, the liveliness tokens of other processes are known after at most so long."""
TOKEN_TIMEOUT_S = 2.5
"""The token of a killed service outlives it by its lease, at most 2 s."""
ANSWERS = 3
"""Answers to different questions that confirm a suspicion; one may be a replayed message."""
ASK_EVERY_S = 0.3
LAPSE_S = 2.0
"""A suspicion lapses, and a confirmation ends, when nothing has been received for so long: several questions."""
YOUNG_S = 5.0
"""Two processes that were started together have received each other by then."""
SUSPECTS_LIMIT = 16
"""Suspected sessions that are followed at once, so that invented ones fill no memory."""


class Stance(Enum):
    """What a service does about another process with its id."""

    GO_ON = "go on"
    WAIT = "wait"
    STAND_BY = "stand by"
    END = "end"


@dataclass(slots=True)
class Suspect:
    """Another session under this service's id.

    since_s: its first message; received_s: its newest. published_s: its newest judgement; epoch: in it. answers: how
    many questions it has answered, the last at answered_s.
    """

    since_s: float
    received_s: float
    epoch: int = 0
    published_s: float = float("-inf")
    answers: int = 0
    answered_s: float = float("-inf")
    question: int = 0
    """The number of the newest question that it has answered."""

    def is_confirmed(self, now_s: float) -> bool:
        """Whether it has answered, and still does."""
        return self.answers >= ANSWERS and now_s - self.answered_s < LAPSE_S

    def has_lapsed(self, now_s: float) -> bool:
        """Whether nothing has been received from it for LAPSE_S."""
        return now_s - max(self.received_s, self.answered_s) >= LAPSE_S


class SameIdDetector:
    """Follows the other sessions under the id of the service with `session`, which began at `began_s`.

    takeover_s: a session that published no judgement for longer counts as standing by.
    """

    def __init__(self, session: str, began_s: float, takeover_s: float) -> None:
        self._session, self._began_s, self._takeover_s = session, began_s, takeover_s
        self._suspects: dict[str, Suspect] = {}
        self._question, self._asked_s = 0, float("-inf")

    @property
    def has_suspects(self) -> bool:
        """Whether a message of another session was received lately."""
        return bool(self._suspects)

    def record_message(self, session: str | None, now_s: float, epoch: int | None = None) -> None:
        """Take the session of a message under this service's id. epoch: of a judgement; None: it is a status."""
        if session is None or session == self._session:
            return
        suspect = self._suspects.get(session)
        if suspect is None or suspect.has_lapsed(now_s):
            self._drop_lapsed(now_s)
            if len(self._suspects) >= SUSPECTS_LIMIT:
                return
            suspect = self._suspects[session] = Suspect(now_s, now_s)
        suspect.received_s = now_s
        if epoch is not None:
            suspect.epoch, suspect.published_s = epoch, now_s

    def next_question(self, now_s: float, *, always: bool = False) -> int | None:
        """The number of the question to ask now; None if none is due. always: even if no session is suspected."""
        if self._suspects:
            self._drop_lapsed(now_s)
        if now_s - self._asked_s < ASK_EVERY_S or not (self._suspects or always):
            return None
        self._asked_s = now_s
        self._question += 1
        return self._question

    def record_answer(self, session: str | None, question: int, now_s: float) -> None:
        """Take an answer of the process with this session; only the first to each question counts."""
        suspect = self._suspects.get(session or "")
        if suspect is not None and question > suspect.question:
            suspect.question, suspect.answered_s = question, now_s
            suspect.answers += 1

    def is_confirmed(self, session: str | None, now_s: float) -> bool:
        """Whether a running process has this session."""
        suspect = self._suspects.get(session or "")
        return suspect is not None and suspect.is_confirmed(now_s)

    def any_confirmed(self, now_s: float) -> bool:
        """Whether another process with this id runs."""
        return any(suspect.is_confirmed(now_s) for suspect in self._suspects.values())

    def stance(self, epoch: int | None, now_s: float) -> Stance:
        """What this service does now. epoch: its own; None while it does not own the scene."""
        stance = Stance.GO_ON
        for session, suspect in self._suspects.items():
            if self._precedence(suspect, session, now_s) < (epoch is not None, epoch or 0, self._session):
                continue
            confirmed, publishes = suspect.is_confirmed(now_s), self._publishes(suspect, now_s)
            if suspect.since_s - self._began_s < YOUNG_S:
                if confirmed:
                    return Stance.END
                if publishes and now_s - suspect.since_s < LAPSE_S:
                    stance = Stance.WAIT
            elif confirmed and publishes and epoch is not None:
                return Stance.STAND_BY
        return stance

    def _publishes(self, suspect: Suspect, now_s: float) -> bool:
        return now_s - suspect.published_s <= self._takeover_s

    def _precedence(self, suspect: Suspect, session: str, now_s: float) -> tuple[bool, int, str]:
        """The larger one stays."""
        return self._publishes(suspect, now_s), suspect.epoch, session

    def _drop_lapsed(self, now_s: float) -> None:
        self._suspects = {
            session: suspect for session, suspect in self._suspects.items() if not suspect.has_lapsed(now_s)
        }


class SameIdError(LabanmeshError):
    """Another fusion service of the same id is alive in the scene."""

    def __init__(self, key: str) -> None:
        super().__init__(
            f"{key}: a fusion service of this id is alive already; stop it, or give this one an id of its own: "
            '[fusion] standby = ["second"] in the scene file, and labanmesh fuse SCENE --id second'
        )


class SameIdWatch:
    """Watches for other processes with the id of a running service in one scene."""

    def __init__(self, session: SubSession, keys: SceneKeys, own: str, detector: SameIdDetector) -> None:
        """session: in which to ask and listen; it is polled elsewhere."""
        self._alive, self._key, self._detector = keys.fusion_alive(own), keys.fusion_status(own), detector
        self._session, self._statuses = session, session.inbox(self._key, limit=16, remote=True)
        self._answers: deque[tuple[int, bytes]] = deque(maxlen=64)
        self.stance = Stance.GO_ON

    def record_judgement(self, message: JudgementMessage, now_s: float) -> bool:
        """Take a judgement under this service's id; returns whether it is from another process that runs."""
        self._detector.record_message(message.session, now_s, message.epoch or 0)
        return self._detector.is_confirmed(message.session, now_s)

    def update(self, epoch: int | None, now_s: float) -> bool:
        """Follow the rules of the module; returns whether another process with this id runs.

        epoch: as in SameIdDetector.stance. Raises SameIdError in the process that is to end.
        """
        for arrival in self._statuses.take(0):
            with suppress(BadMessage):
                status = decode_from(arrival.key, StatusMessage, arrival.payload)
                if status.state in RUNNING:
                    self._detector.record_message(status.session, now_s)
        if self.stance is Stance.GO_ON and not self._detector.has_suspects and not self._answers:
            return False
        self.ask(now_s)
        stance, self.stance = self.stance, self._detector.stance(epoch, now_s)
        if self.stance is Stance.END:
            raise SameIdError(self._alive)
        if Stance.STAND_BY in (stance, self.stance) and stance is not self.stance:
            log.warning("%s: %s: %s", self._alive, SAME_ID_REASON, self.stance.value)
        return self._detector.any_confirmed(now_s)

    def ask(self, now_s: float, *, always: bool = False) -> None:
        """Take the answers of running processes; ask again for the status under this service's own key if it is due.

        always: also if no session is suspected.
        """
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


class IdCheck:
    """Whether a process that starts is the only one with the id `own`. It begins when it is made: what takes a while
    can be done before `is_free`.
    """

    def __init__(self, scenes: Sequence[Scene], own: str, link: Link) -> None:
        # One scene suffices: a process announces itself in all of its scenes.
        keys, first = scenes[0].keys, scenes[0]
        # On one machine the first service listens: with a second one of its id the link could not have been opened.
        self._is_alone = first.mesh.mode == "machine" and own == first.fusion.id
        self._alive, self._detector = keys.fusion_alive(own), SameIdDetector("", float("-inf"), 0.0)
        self._session = link.sub_session()
        self._presence = self._session.presence(self._alive)
        self._watch = SameIdWatch(self._session, keys, own, self._detector)
        self._begun_s = time.monotonic()

    def is_free(self, stop: threading.Event) -> bool:
        """Wait until no other process has the id; False if `stop` was set before.

        The token of a killed process disappears within TOKEN_TIMEOUT_S. A token for which no process answers keeps no
        service away. Raises SameIdError when a process with this id answers.
        """
        asked_s = time.monotonic()
        with self._session:
            if self._is_alone:
                return not stop.is_set()
            # Once in any case: what has arrived while the process was busy needs a moment to be taken.
            while not stop.wait(0.02):
                now_s = time.monotonic()
                if self._alive in self._presence.alive:
                    self._watch.ask(now_s, always=True)
                elif now_s - self._begun_s >= DISCOVERY_S:
                    return True
                if self._detector.any_confirmed(now_s):
                    raise SameIdError(self._alive)
                if now_s - asked_s > TOKEN_TIMEOUT_S:
                    log.warning("%s: a token of this id exists, but no process answers for it", self._alive)
                    return True
        return False
