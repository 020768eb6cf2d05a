"""The verb `labanmesh capture`: everything published in a scene, written to a capture file.

1. The mesh only fills an inbox; one loop empties it into the file and flushes, ten times a second or more.
2. What is published only in answer to queries (the vocabulary) is queried at the start and whenever a process appears.
"""

import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common import SECOND_NS
from common.arrival import APPEARED, GONE, CaptureKind, CaptureRecord
from common.command_options import ForSeconds
from common.config import Scene, read_scene
from common.lifecycle import stop_on_signals
from common.link import Link
from common.text import plural

if TYPE_CHECKING:
    from common.capture_file import CaptureWriter

CAPTURE_TAKE_S = 0.1
"""How long one look into the inbox waits; at most this much is lost when the process is killed."""
CAPTURE_QUERY_S = 0.3
QUERY_AGAIN_NS = 2 * SECOND_NS
INBOX_LIMIT = 65_536
"""Messages that wait while the disk is slow; a scene of four cameras publishes about 200 a second."""
INBOX_BYTES = 64 << 20
"""The largest of them together: twenty seconds of a scene of ten cameras whose messages are full of detail."""
PROGRESS_EVERY_S = 10.0
"""Between two lines of progress; on a terminal one line is written over and over."""
BYTES_PER_MB = 1_000_000


def capture(
    scene: Annotated[Path, typer.Argument(help="The scene file, as given to observe and fuse.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The file to write (.mcap); a new one.")],
    for_s: ForSeconds = None,
) -> None:
    """Write everything published in a scene, with its times, to a file for `labanmesh replay`. Ctrl-C ends it.

    The file stays readable when this process is killed or the disk is full; an existing file is not overwritten.

    Example: labanmesh capture scene.toml -o monday.mcap --for 3600
    """
    from common.capture_file import CaptureWriter

    config = read_scene(scene)
    text = scene.read_text(encoding="utf-8")
    with stop_on_signals(for_s) as stop, Link.open(config.mesh, "hub", scene=config.scene, stop=stop) as link:
        with CaptureWriter(output, config, text, time.time_ns()) as writer:
            summary = record(config, link, writer, lambda: not stop.is_set())
        print(f"{output}: {summary}", flush=True)
        if not summary.messages:
            print(f"received nothing at {config.mesh.endpoint}. Start the scene with: labanmesh up {scene}", flush=True)


@dataclass(frozen=True, slots=True)
class CaptureSummary:
    """What was captured. size: bytes. kinds: messages per kind. left_out: messages that came too fast."""

    messages: int
    size: int
    seconds: float
    kinds: Mapping[str, int]
    left_out: int

    def __str__(self) -> str:
        kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(self.kinds.items()))
        lost = f"; {plural(self.left_out, 'message')} lost to a full queue" if self.left_out else ""
        size_mb = self.size / BYTES_PER_MB
        total = f"{plural(self.messages, 'message')}, {size_mb:.1f} MB in {self.seconds:.0f} s"
        return f"{total}{f' ({kinds})' if kinds else ''}{lost}"


class SceneCapture:
    """One scene on its way into a file; call `step` for as long as it should go on."""

    def __init__(self, scene: Scene, link: Link, writer: "CaptureWriter", clock: Callable[[], int]) -> None:
        self._keys, self._link, self._writer, self._clock = scene.keys, link, writer, clock
        self._kinds: Counter[str] = Counter()
        self._tokens: frozenset[str] = frozenset()
        self._answers: frozenset[tuple[str, bytes]] = frozenset()
        self._inbox = link.inbox(f"{self._keys.root}/**", limit=INBOX_LIMIT, bytes_limit=INBOX_BYTES)
        expected = (*map(self._keys.observer_alive, scene.roster), *map(self._keys.fusion_alive, scene.services))
        self._presence = link.presence(f"{self._keys.root}/**/alive", expected)
        self._began_ns = self._queried_ns = clock()
        self._vocabulary_missing = False
        self._query()

    @property
    def summary(self) -> CaptureSummary:
        """What was captured so far."""
        seconds = (self._clock() - self._began_ns) / SECOND_NS
        left_out = self._inbox.dropped + self._writer.left_out
        return CaptureSummary(self._writer.messages, self._writer.size, seconds, dict(self._kinds), left_out)

    def step(self) -> None:
        """Write what has arrived, after a tenth of a second at the latest.

        Raises LabanmeshError when the file cannot be written.
        """
        for arrival in self._inbox.take(CAPTURE_TAKE_S):
            self._write("put", arrival.key, arrival.payload, arrival.arrived_ns)
        # After the last messages of a process that has gone, in the order in which fusion sees them.
        self._write_tokens()
        if self._vocabulary_missing and self._clock() - self._queried_ns > QUERY_AGAIN_NS:
            self._query()
        self._writer.flush()

    def _write_tokens(self) -> None:
        alive, now_ns = self._presence.alive, self._clock()
        for key in sorted(self._tokens - alive):
            self._write("token", key, GONE, now_ns)
        new = sorted(alive - self._tokens)
        for key in new:
            self._write("token", key, APPEARED, now_ns)
        self._tokens = alive
        if new:
            self._query()

    def _query(self) -> None:
        answers = self._link.ask_each(f"{self._keys.root}/**", CAPTURE_QUERY_S)
        self._queried_ns = self._clock()
        # A process may declare its vocabulary after its token; without any process none is missing.
        answered = any(key == self._keys.vocabulary for key, _ in answers)
        self._vocabulary_missing = not answered and bool(self._presence.alive)
        for key, payload in answers:
            if (key, payload) not in self._answers:
                self._write("answer", key, payload, self._queried_ns)
        self._answers = frozenset(answers)

    def _write(self, kind: CaptureKind, key: str, payload: bytes, arrived_ns: int) -> None:
        self._writer.write(CaptureRecord(kind, key, payload, arrived_ns))
        self._kinds[key.rsplit("/", 1)[-1] if kind == "put" else kind] += 1


def record(scene: Scene, link: Link, writer: "CaptureWriter", go_on: Callable[[], bool]) -> CaptureSummary:
    """Write everything published in `scene` into `writer` while `go_on()`, and show the progress on stderr."""
    scene_capture, end = SceneCapture(scene, link, writer, time.time_ns), "\r" if sys.stderr.isatty() else "\n"
    every_s, shown_s = (CAPTURE_TAKE_S if end == "\r" else PROGRESS_EVERY_S), time.monotonic()
    while go_on():
        scene_capture.step()
        if time.monotonic() - shown_s >= every_s:
            shown_s = time.monotonic()
            print(f"{writer.path}: {scene_capture.summary}", end=end, file=sys.stderr, flush=True)
    scene_capture.step()
    return scene_capture.summary
