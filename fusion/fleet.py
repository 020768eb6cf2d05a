"""Many scenes in one fusion process, shared with other such processes: the loop.

1. Each scene is judged `step_hz` times a second, whether something came or not; what came for it waits until then, and
   of each observer the newest is read. Those that are due together are pooled together.
2. Who is alive is known by the liveliness tokens of all scenes; who takes which scene follows from it (sharing.py).
"""

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice

from common.config import Scene
from common.errors import BadInput
from common.inbox import Presence
from common.keys import observer_of as fusion_of
from common.keys import scene_of
from common.link import Link
from common.notify import Notifier
from common.subsession import SubSession
from fusion.court import Court
from fusion.engine.engine import FusionEngine
from fusion.engine.pooling import pool_many
from fusion.fleet_telling import Round, telling_rounds
from fusion.service import await_namesake
from fusion.sharing import Duty

log = logging.getLogger("labanmesh.fusion")
PAUSE_S = 0.008
"""Between two rounds: who judges hundreds of scenes finds some due in each, and pools them together."""
TOGETHER = 32
"""So many scenes are pooled at once: more save little."""
SETTLED_S = 0.3
"""How long after opening a link it takes to know who else is alive, before anything is taken."""
STALL_S = 1.5
"""Who took no round for so long may be gone for the others: a lease is 2 s (zenoh_settings.py)."""
TELL_S = 1.0


def serve_many(
    scenes: Sequence[Scene], link: Link, stop: threading.Event, clock: Callable[[], int] = time.time_ns
) -> None:
    """VerdictDetector those of the scenes that are this process's share until `stop` is set.

    Raises LabanmeshError when a service of the same id is alive already.
    """
    fleet = Fleet(scenes, link, clock)
    first = scenes[0]
    supervisor = Notifier.from_environment()
    presence = link.presence(f"{first.mesh.prefix}/*/fusion/*/alive")
    await_namesake(presence, first.keys.fusion_alive(first.fusion.id), stop)
    for scene in scenes:
        link.announce(scene.keys.fusion_alive(scene.fusion.id))
    stop.wait(SETTLED_S)
    supervisor.ready(f"judging a share of {len(scenes)} scenes")
    try:
        with telling_rounds(first, len(scenes)) as tell:
            while not stop.is_set():
                tell(fleet.round(presence))
                supervisor.alive()
                stop.wait(PAUSE_S)
    finally:
        fleet.close()
        supervisor.stopping()


class Fleet:
    """This process's part in judging many scenes."""

    def __init__(self, scenes: Sequence[Scene], link: SubSession, clock: Callable[[], int]) -> None:
        self._courts = [Court(scene, _referee_of(scene), link, clock) for scene in scenes]
        now_s = time.monotonic()
        # Spread evenly, and so they stay: judged all at once, the last would wait for the first.
        self._due_s = [now_s + n / len(scenes) / scene.fusion.step_hz for n, scene in enumerate(scenes)]
        self._alive: frozenset[str] | None = None
        self._told_s = self._begun_s = now_s

    def round(self, presence: Presence) -> Round:
        """VerdictDetector what is due, and say how it is once a second."""
        begun_s, before_s = time.monotonic(), self._begun_s
        self._begun_s = begun_s
        if begun_s - before_s > STALL_S:
            log.warning("no round for %.1f s: asking who judges meanwhile", begun_s - before_s)
            for court in self._courts:
                court.doubtful()
        if presence.alive is not self._alive:
            self._alive = presence.alive
            by_scene = _by_scene(self._alive)
            for court in self._courts:
                court.present(by_scene.get(court.scene.scene, ()))
        arrived, labels = self._judge()
        if begun_s - self._told_s >= TELL_S:
            self._told_s = begun_s
            for court in self._courts:
                court.tell()
        judged = sum(court.duty is Duty.JUDGING for court in self._courts)
        return Round(judged, arrived, labels, time.monotonic() - begun_s)

    def close(self) -> None:
        """Leave all scenes."""
        for court in self._courts:
            court.close()

    def _judge(self) -> tuple[int, list[str]]:
        """How many posteriors were read, and the labels of the verdicts on movements that have ended."""
        read, labels = 0, list[str]()
        # Not all that are due, should many be: what was read of the first would grow old.
        for courts in _batched(self._due(), TOGETHER):
            steps = [(court, court.step()) for court in courts]
            told = [(court, step, step.case) for court, step in steps if step.case is not None]
            pools = pool_many([case for _, _, case in told])
            said = [v for (court, step, _), pooled in zip(told, pools, strict=True) for v in court.say(step, pooled)]
            read += sum(step.read for _, step in steps)
            labels += [v.label for v in said if v.ended_ns is not None]
        return read, labels

    def _due(self) -> Iterator[Court]:
        for n, court in enumerate(self._courts):
            behind_s = time.monotonic() - self._due_s[n]
            if behind_s >= 0:
                period_s = 1 / court.scene.fusion.step_hz
                # In step with its own beginning; steps that were missed are not made up for.
                self._due_s[n] += period_s * (1 + behind_s // period_s)
                yield court


def require_shareable(scenes: Sequence[Scene]) -> None:
    """Raises BadInput, one line, for scenes that one process cannot judge together."""
    first, names = scenes[0], set[str]()
    for scene in scenes:
        if scene.scene in names:
            raise BadInput(f"scene {scene.scene!r}: in two of the files; each scene is judged once")
        names.add(scene.scene)
        if scene.mesh != first.mesh:
            raise BadInput(f"scene {scene.scene!r}: another [mesh] than {first.scene!r}; one process has one link")
        if scene.named_vocabulary is None:
            raise BadInput(
                f'scene {scene.scene!r}: no vocabulary; add vocabulary = ["...", ...] to judge it with others'
            )
        if scene.fusion.memory or scene.fusion.standby:
            key = "memory" if scene.fusion.memory else "standby"
            raise BadInput(f"scene {scene.scene!r}: fusion.{key} is for a process of one scene; leave it out")


def _referee_of(scene: Scene) -> Callable[[], FusionEngine]:
    vocabulary = scene.named_vocabulary
    if vocabulary is None:
        raise BadInput(f'scene {scene.scene!r}: no vocabulary; add vocabulary = ["...", ...] to judge it with others')
    return lambda: FusionEngine(scene.scene, list(scene.roster), vocabulary, scene.fusion)


def _by_scene(alive: frozenset[str]) -> Mapping[str, set[str]]:
    found: dict[str, set[str]] = {}
    for key in alive:
        found.setdefault(scene_of(key), set()).add(fusion_of(key))
    return found


def _batched(courts: Iterable[Court], size: int) -> Iterator[list[Court]]:
    rest = iter(courts)
    while batch := list(islice(rest, size)):
        yield batch
