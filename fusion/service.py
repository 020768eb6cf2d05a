"""The referee on the mesh: posteriors in, judgements and verdicts out, and answers to whoever comes late.

1. The mesh only fills an inbox; one loop empties it, and judges once for each lot and `step_hz` times a second.
2. What cannot be read, or does not say what its key says, is counted, logged once a minute and dropped.
3. The last judgement, verdicts, status and the vocabulary answer queries.
4. Of several services the one that leads (leadership.py) speaks; the others hear what it says and go on from there.
5. A verdict is said before the judgement that it came from: whoever takes over in between knows of it.
"""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Protocol

from common.clock_asking import ClockAsker
from common.clock_skew import Reading
from common.config import Scene
from common.errors import LabanmeshError
from common.health import Health
from common.keys import SceneKeys, observer_of
from common.link import Arrival, Link, Presence
from common.messages import Account, JudgementMessage, PosteriorMessage, VerdictMessage, VocabularyMessage
from common.status import StatusBoard
from common.vocabulary import Vocabulary
from common.wire import BadMessage, decode, encode, encode_vocabulary
from fusion.complaints import Complaints
from fusion.leadership import Leadership
from fusion.memory_file import Memory

log = logging.getLogger("labanmesh.fusion")
ASK_S = 1.0
STEPS_MISSED = 2.5
"""A leader that judges at every step is not silent before it has missed so many."""
HEARSAY_S = 0.2
"""How long after opening a link it takes at most to know who is alive."""
NAMESAKE_S = 3.0
"""How long the token of a service that died without closing may outlive it: its lease, and some."""
VERDICTS_KEPT = 10
"""So many of the last verdicts are told to who comes late."""


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

    def read_clock(self, observer: str, reading: Reading) -> None:
        """An observer was asked what time it has."""

    def skew_s(self, observer: str) -> float | None:
        """Seconds by which an observer's clock is ahead of ours; None while it was never asked."""

    def continue_from(self, judgement: JudgementMessage) -> None:
        """Go on where another fusion service was."""

    def judge(self, now_ns: int) -> RulingLike | None:
        """What the judges together believe at `now_ns`; None while there is nothing to judge."""


def serve(
    scene: Scene,
    referee: RefereeLike,
    link: Link,
    stop: threading.Event,
    clock: Callable[[], int] = time.time_ns,
    memory: Memory | None = None,
) -> None:
    """Judge the scene until `stop` is set; with `memory`, a movement that went on before a restart is gone on with.

    Raises LabanmeshError when a service of the same id is alive in the scene.
    """
    keys, fusion = scene.keys, scene.fusion.id
    others = link.presence(keys.fusion_alive())
    _await_namesake(others, keys.fusion_alive(fusion), stop)
    health = Health(scene.scene, fusion)
    ear = Ear(scene.scene, referee, health, clock)
    presence = link.presence(keys.observer_alive())
    inbox = link.inbox(keys.posterior())
    voice = Voice(link, keys, encode_vocabulary(scene.scene, referee.vocabulary), memory)
    voice.recall(scene.scene, referee, clock())
    team = Team(scene, referee, voice, link)
    asker = ClockAsker(link, keys.observer_status(), clock, inbox.wake)
    with StatusBoard(link, keys.fusion_status(fusion), health, clock) as board:
        link.announce(keys.fusion_alive(fusion))
        log.info("judging %s: %s", scene.scene, ", ".join(scene.roster))
        while not stop.is_set():
            arrivals = inbox.take(1 / scene.fusion.step_hz)
            if asker.ask_if_due():
                health.noticed(ear.accounts(scene.roster))
            for observer, reading in asker.readings():
                referee.read_clock(observer, reading)
            for arrival in arrivals:
                ear.hear(arrival)
            # After its last words, so that they do not bring back a judge who has gone.
            referee.present(_ids(presence))
            leads = team.leads(_ids(others), clock())
            if team.news is not None:
                board.become("running", team.news)
            ruling = referee.judge(clock())
            if ruling is not None and leads:
                voice.say(ruling)
    if inbox.dropped:
        log.warning("%d messages came faster than they could be judged and were left out", inbox.dropped)


def _await_namesake(services: Presence, key: str, stop: threading.Event) -> None:
    """A service that was killed may still seem alive for a moment; one that is alive is a mistake in the set-up."""
    begin_s = time.monotonic()
    # Who is alive comes to be known a moment after the link was opened.
    while (waited_s := time.monotonic() - begin_s) < HEARSAY_S or key in services.alive:
        if stop.wait(0.02):
            return
        if waited_s > NAMESAKE_S:
            raise LabanmeshError(
                f"{key}: a fusion service of this id is alive already; stop it, or give this one an id of its own: "
                '[fusion] standby = ["second"] in the scene file, and labanmesh fuse SCENE --id second'
            )


class Team:
    """The fusion services of one scene, as one of them sees it: who leads, and what the leader says."""

    def __init__(self, scene: Scene, referee: RefereeLike, voice: "Voice", link: Link) -> None:
        self._scene, self._referee, self._voice = scene, referee, voice
        self._own = scene.fusion.id
        patience_s = max(scene.fusion.takeover_s, STEPS_MISSED / scene.fusion.step_hz)
        self._leadership = Leadership(self._own, frozenset(scene.services), patience_s)
        # Alone there is nobody to listen to, and one's own words cost time.
        spoken = (scene.keys.verdict, scene.keys.judgement) if scene.fusion.standby else ()
        self._inbox = link.inbox(*spoken)
        self._told: str | None = None
        self.news: str | None = None
        """What the status has to say anew; None when nothing has changed."""

    def leads(self, alive: frozenset[str], now_ns: int) -> bool:
        """Whether to speak now; before that, all that the leader has said is taken over."""
        for arrival in self._inbox.take(0):
            self._hear(arrival, now_ns)
        # After its last words, so that they do not bring back a leader who has gone.
        self._leadership.present(alive, now_ns)
        leads = self._leadership.leads(now_ns)
        leader = self._leadership.leader
        told = "" if leader == self._own else f"standing by for {leader or 'who leads'}"
        self.news = told if told != self._told else None
        if self.news is not None and self._scene.fusion.standby:
            log.info("%s", told or "leading")
        self._told = told
        return leads and leader == self._own

    def _hear(self, arrival: Arrival, now_ns: int) -> None:
        kind = VerdictMessage if arrival.key == self._scene.keys.verdict else JudgementMessage
        try:
            said = decode(kind, arrival.payload)
        except BadMessage as error:
            log.warning("%s: cannot be used: %s", arrival.key, error)
            return
        if said.fusion != self._own and self._leadership.heard(said.fusion, now_ns):
            self._referee.continue_from(said)
            self._voice.note(said, arrival.payload)


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

    def accounts(self, roster: Sequence[str]) -> dict[str, Account]:
        """What was noticed of each observer of the scene, and of others who spoke as if they were."""
        rejected = self._complaints.totals
        return {
            observer: Account(skew_s=self._referee.skew_s(observer), rejected=rejected.get(observer, {}))
            for observer in dict.fromkeys((*roster, *rejected))
        }

    def _refuse(self, observer: str, reason: str, detail: str, now_ns: int) -> None:
        self._referee.reject(observer, reason)
        self._complain(observer, reason, detail, now_ns)

    def _complain(self, observer: str, reason: str, detail: str, now_ns: int) -> None:
        line = self._complaints.note(observer, reason, detail, now_ns)
        if line is not None:
            log.warning("%s", line)


class Voice:
    """Says rulings on the mesh and repeats the last ones to who asks."""

    def __init__(self, link: Link, keys: SceneKeys, vocabulary: bytes, memory: Memory | None = None) -> None:
        self._judgement = link.publisher(keys.judgement)
        self._verdict = link.publisher(keys.verdict)
        self._memory = memory
        self._last: bytes | None = None
        self._verdicts: tuple[bytes, ...] = ()
        self._newest: VerdictMessage | None = None
        link.answer(keys.judgement, lambda: self._last)
        link.answer(keys.verdict, lambda: self._verdicts)
        link.answer(keys.vocabulary, lambda: vocabulary)

    def say(self, ruling: RulingLike) -> None:
        """What was decided, then the judgement."""
        for verdict in ruling.verdicts:
            self.note(verdict, encode(verdict))
            self._verdict.put(self._verdicts[-1])
        self.note(ruling.judgement, encode(ruling.judgement))
        self._judgement.put(self._last or b"")

    def note(self, said: JudgementMessage, payload: bytes) -> None:
        """Something was said, here or by the service that leads: it is what who asks is told."""
        if isinstance(said, VerdictMessage):
            self._verdicts = (*self._verdicts, payload)[-VERDICTS_KEPT:]
            self._newest = said
            return
        self._last = payload
        if self._memory is not None:
            self._memory.keep(said, self._newest)

    def recall(self, scene: str, referee: RefereeLike, now_ns: int) -> None:
        """Go on from what was kept before a restart."""
        found = self._memory.recall(scene, now_ns) if self._memory is not None else None
        if found is None:
            return
        for said in (found.verdict, found.judgement):
            if said is not None:
                referee.continue_from(said)
                self.note(said, encode(said))


def _ids(presence: Presence) -> frozenset[str]:
    return frozenset(observer_of(key) for key in presence.alive)
