"""The referee on the mesh: posteriors in, judgements and verdicts out, and answers to whoever comes late.

1. The mesh only fills an inbox; one loop empties it, and judges once for each lot and `step_hz` times a second.
2. What cannot be read, or does not say what its key says, is counted, logged once a minute and dropped.
3. The last judgement, verdict, status and the vocabulary answer queries.
"""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Protocol

from common.config import Scene
from common.errors import LabanmeshError
from common.health import Health
from common.keys import SceneKeys, observer_of
from common.link import Arrival, Link, Presence
from common.messages import JudgementMessage, PosteriorMessage, VerdictMessage, VocabularyMessage
from common.status import StatusBoard
from common.vocabulary import Vocabulary
from common.wire import BadMessage, decode, encode, encode_vocabulary
from fusion.complaints import Complaints

log = logging.getLogger("labanmesh.fusion")
ASK_S = 1.0


class RulingLike(Protocol):
    """One step's result."""

    @property
    def judgement(self) -> JudgementMessage:
        """What the judges together believe now."""

    @property
    def verdicts(self) -> Sequence[VerdictMessage]:
        """What was decided in this step, if anything."""


class RefereeLike(Protocol):
    """What the service needs of a referee."""

    @property
    def vocabulary(self) -> Vocabulary:
        """The movements that it judges."""

    def hear(self, observer: str, message: PosteriorMessage, now_ns: int) -> str | None:
        """Take one posterior; returns why it was not used, or None."""

    def reject(self, observer: str, reason: str) -> None:
        """Count a message that could not even be read."""

    def present(self, observers: frozenset[str]) -> None:
        """Who is alive on the mesh now."""

    def judge(self, now_ns: int) -> RulingLike | None:
        """What the judges together believe at `now_ns`; None while there is nothing to judge."""


def serve(
    scene: Scene,
    referee: RefereeLike,
    link: Link,
    stop: threading.Event,
    clock: Callable[[], int] = time.time_ns,
) -> None:
    """Judge the scene until `stop` is set."""
    keys, fusion = scene.keys, scene.fusion.id
    health = Health(scene.scene, fusion)
    ear = Ear(scene.scene, referee, health, clock)
    presence = link.presence(keys.observer_alive())
    inbox = link.inbox(keys.posterior())
    voice = Voice(link, keys, encode_vocabulary(scene.scene, referee.vocabulary))
    with StatusBoard(link, keys.fusion_status(fusion), health, clock) as board:
        link.announce(keys.fusion_alive(fusion))
        board.become("running")
        log.info("judging %s: %s", scene.scene, ", ".join(scene.roster))
        while not stop.is_set():
            arrivals = inbox.take(1 / scene.fusion.step_hz)
            for arrival in arrivals:
                ear.hear(arrival)
            # After its last words, so that they do not bring back a judge who has gone.
            referee.present(_ids(presence))
            ruling = referee.judge(clock())
            if ruling is not None:
                voice.say(ruling)
    if inbox.dropped:
        log.warning("%d messages came faster than they could be judged and were left out", inbox.dropped)


def known_vocabulary(scene: Scene, link: Link, stop: threading.Event) -> Vocabulary | None:
    """The vocabulary that the scene names, else that of the first observer who answers; None when stopped before."""
    if scene.named_vocabulary is not None:
        return scene.named_vocabulary
    log.info("%s names no vocabulary: asking the observers for theirs", scene.scene)
    while not stop.is_set():
        for payload in link.ask(scene.keys.vocabulary, ASK_S).values():
            try:
                said = decode(VocabularyMessage, payload)
                return Vocabulary(tuple(said.labels), said.name)
            except LabanmeshError as error:
                log.warning("a vocabulary that cannot be used: %s", error)
    return None


class Ear:
    """From arrived bytes to the referee, who is told of each message that he gets and of each that he does not."""

    def __init__(self, scene: str, referee: RefereeLike, health: Health, clock: Callable[[], int]) -> None:
        self._scene, self._referee, self._health, self._clock = scene, referee, health, clock
        self._complaints = Complaints()

    def hear(self, arrival: Arrival) -> None:
        """One message; a bad one is counted and dropped, never raised."""
        observer, now_ns = observer_of(arrival.key), self._clock()
        try:
            message = decode(PosteriorMessage, arrival.payload)
        except BadMessage as error:
            self._refuse(observer, error.reason, error.detail, now_ns)
            return
        if (message.scene, message.observer) != (self._scene, observer):
            said = f"{message.observer} in {message.scene} said under {arrival.key}"
            self._refuse(observer, "wrong_key", said, now_ns)
            return
        reason = self._referee.hear(observer, message, now_ns)
        if reason is None:
            self._health.frame(message.captured_ns, now_ns)
        else:
            self._complain(observer, reason, f"seq {message.seq} of session {message.session}", now_ns)

    def _refuse(self, observer: str, reason: str, detail: str, now_ns: int) -> None:
        self._referee.reject(observer, reason)
        self._complain(observer, reason, detail, now_ns)

    def _complain(self, observer: str, reason: str, detail: str, now_ns: int) -> None:
        line = self._complaints.note(observer, reason, detail, now_ns)
        if line is not None:
            log.warning("%s", line)


class Voice:
    """Says rulings on the mesh and repeats the last ones to who asks."""

    def __init__(self, link: Link, keys: SceneKeys, vocabulary: bytes) -> None:
        self._judgement = link.publisher(keys.judgement)
        self._verdict = link.publisher(keys.verdict)
        self._last: dict[str, bytes] = {}
        link.answer(keys.judgement, lambda: self._last.get("judgement"))
        link.answer(keys.verdict, lambda: self._last.get("verdict"))
        link.answer(keys.vocabulary, lambda: vocabulary)

    def say(self, ruling: RulingLike) -> None:
        """The judgement, then what was decided in it."""
        self._last["judgement"] = encode(ruling.judgement)
        self._judgement.put(self._last["judgement"])
        for verdict in ruling.verdicts:
            self._last["verdict"] = encode(verdict)
            self._verdict.put(self._last["verdict"])


def _ids(presence: Presence) -> frozenset[str]:
    return frozenset(observer_of(key) for key in presence.alive)
