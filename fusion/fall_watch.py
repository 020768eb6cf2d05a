"""Watches for falls in one scene: postures in, the stage of the watch out (docs/design/falls.md).

Every service that takes part in the scene watches, so that a standby service knows the stage when it takes over; the
owner alone publishes.
"""

import logging
import os
from pathlib import Path
from typing import TYPE_CHECKING

from common import SECOND_NS
from common.config import Scene
from common.errors import reason_of
from common.fall_messages import FallMessage, PostureMessage
from common.files import open_private
from common.keys import observer_of
from common.messages import Agreement
from common.wire import SIZE_LIMIT, BadMessage, decode, encode
from fusion.engine.falls import FallDetector, FallState

if TYPE_CHECKING:
    from fusion.scene_worker import Service

log = logging.getLogger("labanmesh.fusion")
EVERY_NS = SECOND_NS
"""The stage is published again so often, because a message may have been lost."""
FORGET_NS = 3600 * SECOND_NS
"""A stage that is older is not continued: nobody knows what has happened since."""


class FallWatch:
    """The watch of one scene, whose [watch.fallen] is on.

    memory: the file from which the next process of this service continues; None: it begins anew. So a kill while
    somebody lies neither loses the alarm nor its end.
    """

    def __init__(self, scene: Scene, service: "Service", after_s: float, memory: Path | None = None) -> None:
        self._payload: bytes | None = None
        self.owns = False
        self._scene, self._service, self._detector = scene, service, FallDetector(after_s)
        self._session = service.link.sub_session(polled=service.polled)
        self._postures = self._session.newest(*map(scene.keys.posture, scene.roster))
        self._publisher = self._session.publisher(scene.keys.fall, priority="high")
        self._session.answer(scene.keys.fall, lambda: self._payload if self.owns else None)
        self._lying: dict[str, tuple[int, float | None]] = {}
        self._drop_ns = round(scene.fusion.drop_s * SECOND_NS)
        self._sent: tuple[int, str] = (0, "")
        self._stage, self._ids = "unknown", (0, "")
        self._memory = memory
        self._restore()

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
            self._lying[observer_of(arrival.key)] = now_ns, message.lying
        lying = {name: p if now_ns - at_ns <= self._drop_ns else None for name, (at_ns, p) in self._lying.items()}
        if not lying:
            return
        state = self._detector.update(lying, now_ns)
        changed, self._stage = state.stage != self._stage, state.stage
        if changed and state.number != self._ids[0]:
            self._ids = state.number, f"fall-{self._service.session[:8]}-{state.number}"
        sent_ns, stage = self._sent
        if stage != state.stage or not 0 <= now_ns - sent_ns < EVERY_NS:
            self._sent = now_ns, state.stage
            self._publish(state, lying, now_ns)
            if changed:
                self._remember()
        if changed and owns:
            _log(self._scene.scene, state)

    def close(self) -> None:
        """End all subscriptions and publications."""
        self._session.close()

    def _restore(self) -> None:
        """Continue from the stage in the file, if there is one that is not too old."""
        now_ns = self._service.clock()
        try:
            with open(self._memory or os.devnull, "rb") as file:  # noqa: PTH123 - the null device is no path of ours
                message = decode(FallMessage, file.read(SIZE_LIMIT + 1))
        except (OSError, BadMessage):
            return
        if message.scene == self._scene.scene and 0 <= now_ns - message.at_ns < FORGET_NS:
            self._detector.restore(message.stage, message.since_ns, now_ns)
            self._stage, self._ids = message.stage, (0, message.id or "")

    def _remember(self) -> None:
        """Write the stage; a fault is one line, and the watch goes on."""
        if self._memory is None or self._payload is None:
            return
        temporary = self._memory.with_name(f"{self._memory.name}.new")
        try:
            with os.fdopen(open_private(temporary), "wb") as file:
                file.write(self._payload)
            temporary.replace(self._memory)
        except OSError as error:
            log.warning("%s: the stage of the watch for falls is not kept: %s", self._memory, reason_of(error))
            self._memory = None

    def _publish(self, state: FallState, lying: dict[str, float | None], now_ns: int) -> None:
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
        )
        self._payload = encode(message)
        if self.owns:
            self._publisher.put(self._payload)


def _log(scene: str, state: FallState) -> None:
    level = logging.WARNING if state.stage == "fallen" else logging.INFO
    log.log(level, "%s: %s, %d of %d observers see the person lie", scene, state.stage, state.k, state.n)
