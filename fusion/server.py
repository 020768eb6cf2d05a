"""A fusion service: the loop over its scenes, one or hundreds.

1. The mesh only fills inboxes and rings; one loop empties them.
2. A service of few scenes fuses a scene as soon as posteriors arrive, and at least `step_hz` times a second. A service
   of many fuses each scene `step_hz` times a second, of each observer the newest posterior, and pools the scenes that
   are due together.
3. Which service owns which scene is decided in ownership.py, scene by scene.
"""

import logging
import secrets
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import islice

from common import SECOND_NS
from common.config import Scene
from common.errors import LabanmeshError
from common.inbox import Arrival
from common.keys import scene_of
from common.link import Link
from common.messages import VerdictMessage
from common.notify import Notifier
from common.status import STATUS_EVERY_S
from fusion.engine.pooling import pool_steps
from fusion.ingest import FLOOD
from fusion.instrumentation import ServerStep, instrumented
from fusion.membership import SceneMember
from fusion.ownership import Role
from fusion.publisher import JudgementBatch, put_now
from fusion.same_id import IdCheck
from fusion.service import Service

log = logging.getLogger("labanmesh.fusion")
FEW_SCENES = 8
"""Up to this many scenes each subscription has a thread of its own, which costs memory and saves milliseconds."""
BATCH_PAUSE_S = 0.008
"""Between two rounds over many scenes; the scenes that are due in a round are pooled together."""
BATCH = 32
"""Scenes that are pooled at once; more save little."""
FRAME_SET_NS = 2_000_000
"""Posteriors that arrive within this time are one frame set."""
FRAME_SET_WAIT_S = 0.0003
"""The first of a frame set waits for the others at most this long."""
FIND_S = 0.03
"""After it has subscribed to their tokens, a service knows in this time which others were there before it."""
ASK_CLOCKS_S = 60.0
"""Asking a thousand observers every second would cost as much as receiving their posteriors."""
MOST_DRIFT_NS = 20_000_000
"""A wall clock that differs by more was set; less is how exactly clocks are compared over a network."""


def serve(
    scenes: Sequence[Scene],
    own: str,
    link: Link,
    stop: threading.Event,
    clock: Callable[[], int] | None = None,
    *,
    shared: bool = False,
    id_check: IdCheck | None = None,
) -> None:
    """Take part in the fusion of `scenes` as the service `own` until `stop` is set.

    shared: scenes that name no standby services are shared with all other services of these scenes. clock: Unix epoch
    in ns; None: a SteadyClock. id_check: one that has begun already. Raises LabanmeshError when another process has
    this id.
    """
    supervisor = Notifier.from_environment()
    if not (id_check or IdCheck(scenes, own, link)).is_free(stop):
        return
    server = FusionServer(scenes, own, link, clock, shared=shared, supervisor=supervisor)
    fault = ""
    try:
        with instrumented(server.members, own) as record:
            supervisor.ready()
            log.info("serving %s as %s", ", ".join(scene.scene for scene in scenes[:5]), own)
            if shared and stop.wait(FIND_S):
                return
            server.join()
            while not stop.is_set():
                record(server.step())
                supervisor.alive()
    except BaseException as error:
        fault = f"{type(error).__name__}: {error}"[:200]
        raise
    finally:
        server.close(fault)
        supervisor.stopping()
    if server.dropped:
        log.warning("%d posteriors arrived faster than they could be fused and were left out", server.dropped)


class FusionServer:
    """The scenes of one fusion service; `step` does everything that is due."""

    def __init__(
        self,
        scenes: Sequence[Scene],
        own: str,
        link: Link,
        clock: Callable[[], int] | None,
        *,
        shared: bool,
        supervisor: Notifier,
    ) -> None:
        self._polled, self._ticks = len(scenes) > FEW_SCENES, time.monotonic
        self._steady, self._frame_set, self._judgements_out = SteadyClock(), FrameSet(), JudgementBatch()
        keys = () if self._polled else tuple(scene.keys.posterior() for scene in scenes)
        self._inbox = link.inbox(*keys)
        service = Service(
            own=own,
            session=secrets.token_hex(8),
            link=link,
            clock=clock or self._steady,
            ticks=self._ticks,
            shared=shared,
            polled=self._polled,
            wake=self._inbox.wake,
            ask_clocks_s=ASK_CLOCKS_S if self._polled else 1.0,
            put=self._judgements_out.put if self._polled else put_now,
            supervisor=supervisor if len(scenes) == 1 else Notifier(""),
        )
        self.members = [SceneMember(scene, service) for scene in scenes]
        now_s = self._ticks()
        # Spread evenly, so that the last scene does not wait for the first.
        self._due_s = [now_s + n / len(scenes) / scene.fusion.step_hz for n, scene in enumerate(scenes)]
        self._status_s = now_s

    @property
    def dropped(self) -> int:
        """Posteriors that were left out since the start because the inbox was full."""
        return self._inbox.dropped

    def join(self) -> None:
        """Announce this service in all scenes; to be called before the first step."""
        for member in self.members:
            member.join()

    def step(self) -> ServerStep:
        """Wait until something is due, at most one period, and do it."""
        arrivals, of_scenes = self._take(), dict[str, list[Arrival]]()
        begun_s = self._ticks()
        for arrival in arrivals:
            of_scenes.setdefault(scene_of(arrival.key), []).append(arrival)
        received = read = 0
        published: list[VerdictMessage] = []
        # In batches, so that the posteriors of the first scenes do not grow old when many are due.
        for batch in _batched(self._due(of_scenes), BATCH):
            workers = [(member.current(self._ticks()), own) for member, own in batch]
            steps = [(worker, worker.collect(own)) for worker, own in workers if worker is not None]
            received += sum(step.received for _, step in steps)
            read += sum(step.read for _, step in steps)
            pools = iter(pool_steps([case for _, step in steps for case in step.cases]))
            for worker, step in steps:
                published += worker.finish(step, pools)
            self._judgements_out.flush()
            # No listener waits for the rest.
            for worker, _ in steps:
                worker.read_clocks()
            for member, _ in batch:
                member.update()
        if begun_s - self._status_s >= STATUS_EVERY_S:
            self._status_s = begun_s
            for member in self.members:
                member.publish_status()
            if all(member.at_rest for member in self.members):
                self._steady.follow()
        owned = [member.ownership.role for member in self.members].count(Role.OWNER)
        return ServerStep(published, owned, received, read, self.dropped, self._ticks() - begun_s)

    def close(self, fault: str = "") -> None:
        """Leave all scenes. fault: why the service failed; "": it stops in order."""
        for member in self.members:
            # The link may have been closed before.
            with suppress(LabanmeshError):
                member.close(fault)

    def _take(self) -> list[Arrival]:
        """What has arrived, with the rest of a frame set that has begun to arrive; waits until something is due."""
        pause_s = BATCH_PAUSE_S if self._polled else max(0.0, min(self._due_s) - self._ticks())
        arrivals = self._inbox.take(pause_s)
        if self._polled or not 0 < len(arrivals) <= FLOOD:
            return arrivals
        waits_until_s = self._ticks() + FRAME_SET_WAIT_S
        self._frame_set.add(arrivals)
        while self._frame_set.missing and (left_s := waits_until_s - self._ticks()) > 0:
            more = self._inbox.take(left_s)
            self._frame_set.add(more)
            arrivals += more
        return arrivals

    def _due(self, arrivals: dict[str, list[Arrival]]) -> Iterator[tuple[SceneMember, Sequence[Arrival]]]:
        """Scenes with arrivals, and scenes whose time has come."""
        for n, member in enumerate(self.members):
            own = arrivals.get(member.scene.scene, ()) if arrivals else ()
            late_s = self._ticks() - self._due_s[n]
            if late_s < 0 and not own:
                continue
            period_s = 1 / member.scene.fusion.step_hz
            if self._polled:
                # Steps that were missed are not made up for; the phase stays.
                self._due_s[n] += period_s * (1 + late_s // period_s)
            else:
                self._due_s[n] = self._ticks() + period_s
            yield member, own


class FrameSet:
    """The posteriors that arrive together: observers whose cameras run in step publish at the same time.

    Judged one by one, the last of a set would wait for the judgements of all others. Keys that arrive within
    FRAME_SET_NS of the first belong to its set. The last set tells how many to expect; of cameras out of step that is
    one.
    """

    def __init__(self) -> None:
        self._begun_ns = 0
        self._keys: set[str] = set()
        self._expected = 1

    def add(self, arrivals: Sequence[Arrival]) -> None:
        """Note arrivals in order."""
        for arrival in arrivals:
            if not 0 <= arrival.arrived_ns - self._begun_ns < FRAME_SET_NS:
                self._begun_ns, self._expected = arrival.arrived_ns, len(self._keys)
                self._keys = set()
            self._keys.add(arrival.key)

    @property
    def missing(self) -> bool:
        """Whether the present set has fewer posteriors than the one before."""
        return len(self._keys) < self._expected


class SteadyClock:
    """Unix epoch in ns that does not jump when the wall clock is set: the wall clock at one time, and ticks since.

    A jump within a movement would change its id, its hold times and the ages of posteriors. `follow` takes over a wall
    clock that was set; to be called while no movement is in progress.
    """

    def __init__(
        self, wall_ns: Callable[[], int] = time.time_ns, ticks_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._wall_ns, self._ticks_ns = wall_ns, ticks_ns
        self._offset_ns = wall_ns() - ticks_ns()

    def __call__(self) -> int:
        """The time now."""
        return self._offset_ns + self._ticks_ns()

    def follow(self) -> None:
        """Take over the wall clock if it differs by more than MOST_DRIFT_NS."""
        offset_ns = self._wall_ns() - self._ticks_ns()
        if abs(offset_ns - self._offset_ns) > MOST_DRIFT_NS:
            log.info("the clock of this machine was set by %+.3f s", (offset_ns - self._offset_ns) / SECOND_NS)
            self._offset_ns = offset_ns


def _batched(
    due: Iterable[tuple[SceneMember, Sequence[Arrival]]], size: int
) -> Iterator[list[tuple[SceneMember, Sequence[Arrival]]]]:
    rest = iter(due)
    while batch := list(islice(rest, size)):
        yield batch
