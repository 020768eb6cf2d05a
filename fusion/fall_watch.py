"""Watches for falls in one scene: postures in, the stage of the watch out (docs/design/falls.md).

Every service that takes part in the scene watches, so that a standby service knows the stage when it takes over; the
owner alone publishes.
"""

import logging
import os
from collections.abc import Callable, Mapping
from pathlib import Path

from common import SECOND_NS
from common.config import Scene
from common.errors import reason_of
from common.fall_messages import FallMessage, PostureMessage
from common.files import open_private
from common.keys import observer_of
from common.messages import Agreement
from common.subsession import Publisher
from common.wire import SIZE_LIMIT, BadMessage, decode, encode
from fusion.engine.falls import FallDetector, FallState
from fusion.people import ScenePeople
from fusion.scene_worker import SceneWorker
from fusion.service import Service

log = logging.getLogger("labanmesh.fusion")
EVERY_NS = SECOND_NS
"""The stage is published again so often, because a message may have been lost."""
FORGET_NS = 3600 * SECOND_NS
"""A stage that is older is not continued: nobody knows what has happened since."""


class FallWatch:
    """The watch of one scene, whose [watch.fallen] is on.

    memory: the file from which the next process of this service continues; None: it begins anew. So a kill while
    somebody lies neither loses the alarm nor its end. worker: what judges the scene here now; in one that judges
    several people it knows who is who. Whoever lies keeps their id, and is expected there, until they are up.
    """

    def __init__(
        self,
        scene: Scene,
        service: Service,
        after_s: float,
        memory: Path | None = None,
        worker: Callable[[], SceneWorker | None] = lambda: None,
    ) -> None:
        self.owns = False
        self._service, self._worker = service, worker
        self._session = service.link.sub_session(polled=service.polled)
        self._postures = self._session.newest(*map(scene.keys.posture, scene.roster))
        publisher = self._session.publisher(scene.keys.fall, priority="high")
        self._watched = [
            _WatchedPerson(
                scene, service, after_s, publisher, memory if n == 0 else _beside(memory, str(person)), person
            )
            for n, person in enumerate(scene.people.judged)
        ]
        self._session.answer(scene.keys.fall, self._answers)
        self._seen: dict[str, tuple[int, PostureMessage]] = {}
        self._drop_ns = round(scene.fusion.drop_s * SECOND_NS)

    def step(self, owns: bool) -> None:
        """Take the newest postures, decide, and publish if this service owns the scene."""
        self.owns = owns
        self._session.poll()
        now_ns = self._service.clock()
        for arrival in self._postures.take():
            try:
                message = decode(PostureMessage, arrival.payload)
            except BadMessage as error:
                log.debug("%s: %s", arrival.key, error)
                continue
            self._seen[observer_of(arrival.key)] = now_ns, message
        if not self._seen:
            return
        worker = self._worker()
        people = None if worker is None else worker.people
        lying: dict[str | None, dict[str, float]] = {}
        for observer, (at_ns, message) in self._seen.items():
            if now_ns - at_ns <= self._drop_ns:
                for person, p in self._of_people(observer, message, people).items():
                    lying.setdefault(person, {})[observer] = p
        for each in self._watched:
            own = lying.get(each.person, {})
            if own or each.person is None or each.has_begun:
                each.update({observer: own.get(observer) for observer in self._seen}, now_ns, owns)
        if people is not None:
            people.kept = frozenset(each.person for each in self._watched if each.person and each.lies)

    def close(self) -> None:
        """End all subscriptions and publications."""
        self._session.close()

    def _of_people(self, observer: str, message: PostureMessage, people: ScenePeople | None) -> dict[str | None, float]:
        """P(lying) of each person in one observer's message.

        What is no track is of the one person who is there; if there are several, nobody knows whose it is. While nobody
        is known all are the first, who is as low as the one who lies.
        """
        first = self._watched[0].person
        present = () if people is None else people.present
        if message.people is None:
            alone = first if not present else present[0] if len(present) == 1 else None
            return {} if message.lying is None or (alone is None and first is not None) else {alone: message.lying}
        result: dict[str | None, float] = {}
        for track, p in message.people.items():
            person = None if people is None else people.person_of(observer, track)
            if person is not None or not present:
                whose = person or first
                result[whose] = max(p, result.get(whose, 0.0))
        return result

    def _answers(self) -> list[bytes]:
        """The last message on each person."""
        return [each.payload for each in self._watched if self.owns and each.payload is not None]


class _WatchedPerson:
    """The stages of one person. person: None in a scene that judges one; memory: as of `FallWatch`."""

    def __init__(
        self,
        scene: Scene,
        service: Service,
        after_s: float,
        publisher: Publisher,
        memory: Path | None,
        person: str | None,
    ) -> None:
        self.person = person
        self.payload: bytes | None = None
        self._scene, self._service, self._publisher = scene, service, publisher
        self._detector = FallDetector(after_s)
        self._sent: tuple[int, str] = (0, "")
        self._stage, self._ids = "unknown", (0, "")
        self._memory = memory
        self._restore()

    @property
    def has_begun(self) -> bool:
        """Whether there is a stage."""
        return self._sent[0] > 0 or self._stage != "unknown"

    @property
    def lies(self) -> bool:
        """Whether the person lies, as far as is known."""
        return self._stage in ("low", "fallen")

    def update(self, lying: Mapping[str, float | None], now_ns: int, owns: bool) -> None:
        """Decide, and publish if this service owns the scene."""
        state = self._detector.update(lying, now_ns)
        changed, self._stage = state.stage != self._stage, state.stage
        if changed and state.number != self._ids[0]:
            parts = ["fall", self._service.session[:8], *filter(None, [self.person]), str(state.number)]
            self._ids = state.number, "-".join(parts)
        sent_ns, stage = self._sent
        if stage != state.stage or not 0 <= now_ns - sent_ns < EVERY_NS:
            self._sent = now_ns, state.stage
            self._publish(state, lying, now_ns, owns)
            if changed:
                self._remember()
        if changed and owns:
            _log(self._scene.scene, self.person, state)

    def _restore(self) -> None:
        """Continue from the stage in the file, if there is one that is not too old."""
        now_ns = self._service.clock()
        try:
            with open(self._memory or os.devnull, "rb") as file:  # noqa: PTH123 - the null device is no path of ours
                message = decode(FallMessage, file.read(SIZE_LIMIT + 1))
        except (OSError, BadMessage):
            return
        is_own = message.scene == self._scene.scene and message.person == self.person
        if is_own and 0 <= now_ns - message.at_ns < FORGET_NS:
            self._detector.restore(message.stage, message.since_ns, now_ns)
            self._stage, self._ids = message.stage, (0, message.id or "")

    def _remember(self) -> None:
        """Write the stage; a fault is one line, and the watch goes on."""
        if self._memory is None or self.payload is None:
            return
        temporary = self._memory.with_name(f"{self._memory.name}.new")
        try:
            with os.fdopen(open_private(temporary), "wb") as file:
                file.write(self.payload)
            temporary.replace(self._memory)
        except OSError as error:
            log.warning("%s: the stage of the watch for falls is not kept: %s", self._memory, reason_of(error))
            self._memory = None

    def _publish(self, state: FallState, lying: Mapping[str, float | None], now_ns: int, owns: bool) -> None:
        message = FallMessage(
            scene=self._scene.scene,
            fusion=self._service.own,
            session=self._service.session,
            at_ns=now_ns,
            stage=state.stage,
            since_ns=state.since_ns,
            id=self._ids[1] or None,
            lying=state.p,
            agreement=Agreement(k=state.k, n=state.n),
            observers={name: p for name, p in lying.items() if p is not None},
            person=self.person,
        )
        self.payload = encode(message)
        if owns:
            self._publisher.put(self.payload)


def _beside(memory: Path | None, person: str) -> Path | None:
    return None if memory is None else memory.with_name(f"{memory.name}-{person}")


def _log(scene: str, person: str | None, state: FallState) -> None:
    level, who = logging.WARNING if state.stage == "fallen" else logging.INFO, f" {person}" if person else ""
    log.log(level, "%s:%s %s, %d of %d observers see the person lie", scene, who, state.stage, state.k, state.n)
