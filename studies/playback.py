"""Playing a capture back onto a mesh: every message under its key, at its time, and who came and went.

1. One session says everything; each liveliness token has a session of its own, so that it can go as its process went.
2. With the referee's words in it the replay takes the referee's place: on one machine it is where the others meet.
   With posteriors alone a referee has to be there, and is waited for.
3. Who asks gets the last value, as from the processes themselves; the vocabulary from the beginning.
"""

import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from common.capture_file import APPEARED, CaptureRecord
from common.errors import BadInput, LabanmeshError
from common.link import Link, Publisher
from studies.moved_times import MovedTimes

if TYPE_CHECKING:
    from common.capture_file import CaptureFile
    from common.config import Scene

LISTENER_S = 10.0
AUDIENCE_S = 1.0
"""How long is waited for somebody to listen: a referee must, an audience may."""
BREATH = 64
BREATH_S = 0.001
"""As fast as possible is so many messages at once: what floods Zenoh is dropped by it."""
VERDICTS_KEPT = 10
"""So many of the last verdicts are told to who comes late, as by the referee."""
ANSWERED = ("judgement", "verdict", "status", "vocabulary")


@dataclass(frozen=True, slots=True)
class Manner:
    """How to play: speed (0: as fast as possible), posteriors alone or everything, the very bytes or moved to now."""

    speed: float = 1.0
    posteriors_only: bool = False
    as_recorded: bool = False


@dataclass(slots=True)
class Outline:
    """What must be known of a capture before it is played: its times, how much it is, and its vocabularies."""

    records: int = 0
    first_ns: int = 0
    last_ns: int = 0
    vocabularies: dict[str, CaptureRecord] = field(default_factory=dict)

    @classmethod
    def of(cls, capture: "CaptureFile") -> "Outline":
        """One look through the file; raises LabanmeshError for one in which nothing was heard."""
        found = cls()
        for record in capture.records():
            found.first_ns = found.first_ns or record.arrived_ns
            found.last_ns = max(found.last_ns, record.arrived_ns)
            found.records += 1
            if record.key.endswith("/vocabulary"):
                found.vocabularies.setdefault(record.key, record)
        if not found.records:
            raise LabanmeshError(f"{capture.path}: nothing was heard in it, so that there is nothing to play")
        return found


def play(
    capture: "CaptureFile",
    scene: "Scene",
    manner: Manner,
    stop: threading.Event,
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> int:
    """Say the capture onto the mesh of `scene` until its end or `stop`; returns how many messages were said.

    Raises BadInput for another scene's messages that may not be changed, LabanmeshError when no referee listens.
    """
    if manner.as_recorded and scene.scene != capture.scene.scene:
        raise BadInput(
            f"--as-recorded: the messages say scene {capture.scene.scene!r}, {scene.scene!r} would refuse them; leave "
            "--as-recorded out or name a scene file of that scene"
        )
    outline = Outline.of(capture)
    with ExitStack() as open_links:
        mouth = open_links.enter_context(Link.open(scene.mesh, "hub" if manner.posteriors_only else "fusion"))
        stage = _Stage(capture, scene, manner, mouth, open_links, outline)
        for record in outline.vocabularies.values():
            stage.answer(record)
        stage.wait_for_listeners()
        return stage.play(stop, progress)


class _Stage:
    """The sessions through which a capture is said."""

    def __init__(
        self, capture: "CaptureFile", scene: "Scene", manner: Manner, mouth: Link, links: ExitStack, outline: Outline
    ) -> None:
        self._capture, self._scene, self._manner, self._mouth, self._outline = capture, scene, manner, mouth, outline
        self._links = links
        self._tokens: dict[str, Link] = {}
        self._publishers: dict[str, Publisher] = {}
        self._last: dict[str, deque[CaptureRecord]] = {}
        self._times = self._begin()

    def _begin(self) -> MovedTimes:
        outline = self._outline
        run = secrets.token_hex(4)
        first_ns, last_ns, now_ns = outline.first_ns, outline.last_ns, time.time_ns()
        return MovedTimes(first_ns, last_ns, now_ns, self._manner.speed, self._scene.scene, run)

    def wait_for_listeners(self) -> None:
        """Give those who listen time to be found."""
        keys, mesh = self._scene.keys, self._scene.mesh
        if not self._manner.posteriors_only:
            self._publisher(keys.judgement).wait_for_subscriber(AUDIENCE_S)
        elif not self._publisher(keys.posterior(self._capture.scene.roster[0])).wait_for_subscriber(LISTENER_S):
            raise LabanmeshError(
                f"mesh.endpoint = {mesh.endpoint!r}: nobody there listens to posteriors; start `labanmesh fuse` first"
            )

    def play(self, stop: threading.Event, progress: Callable[[str, int, int], None]) -> int:
        """All of it, at its time."""
        self._times, said = self._begin(), 0
        for number, record in enumerate(self._capture.records(), 1):
            if self._manner.posteriors_only and not self._is_an_observers(record):
                continue
            wait_s = (self._times.due_ns(record.arrived_ns) - time.time_ns()) / 1e9
            if not self._manner.speed:
                wait_s = 0 if number % BREATH else BREATH_S
            if stop.wait(wait_s) if wait_s > 0 else stop.is_set():
                break
            said += self._say(record)
            progress("playing", number, self._outline.records)
        return said

    def _is_an_observers(self, record: CaptureRecord) -> bool:
        what = record.key.rsplit("/", 1)[-1]
        below = record.key.startswith(f"{self._capture.scene.keys.root}/observer/")
        return below and (record.kind == "token" or (record.kind == "put" and what == "posterior"))

    def _say(self, record: CaptureRecord) -> bool:
        if record.kind == "token":
            self._show(record)
        else:
            self.answer(record)
        if record.kind == "put":
            self._publisher(self._key(record)).put(self._payload(record))
        return record.kind == "put"

    def answer(self, record: CaptureRecord) -> None:
        """From now on who asks gets this."""
        key = self._key(record)
        if key.rsplit("/", 1)[-1] not in ANSWERED:
            return
        if key not in self._last:
            self._last[key] = deque(maxlen=VERDICTS_KEPT if key == self._scene.keys.verdict else 1)
            # A status is dated when it is asked for: the referee learns from it what the clocks show.
            self._mouth.answer(key, lambda: [self._payload(last) for last in tuple(self._last[key])])
        self._last[key].append(record)

    def _show(self, record: CaptureRecord) -> None:
        key = self._key(record)
        if (gone := self._tokens.pop(key, None)) is not None:
            gone.close()
        if record.payload == APPEARED:
            self._tokens[key] = self._links.enter_context(Link.open(self._scene.mesh, "hub"))
            self._tokens[key].announce(key)

    def _key(self, record: CaptureRecord) -> str:
        return self._scene.keys.root + record.key.removeprefix(self._capture.scene.keys.root)

    def _payload(self, record: CaptureRecord) -> bytes:
        return record.payload if self._manner.as_recorded else self._times.payload(record, time.time_ns())

    def _publisher(self, key: str) -> Publisher:
        if key not in self._publishers:
            self._publishers[key] = self._mouth.publisher(key)
        return self._publishers[key]
