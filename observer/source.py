"""Where an observer's frames come from: recorded motion, played in real time, faster, or as fast as possible."""

import itertools
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from common.config import Scene
from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import read_archive
from observer.tracks import Frame

SECOND_NS = 1_000_000_000
PLAYBACK_START = "LABANMESH_PLAYBACK_START_NS"
"""Environment variable: when (Unix epoch, ns) all observers of a scene begin to play, so that they see the same."""

Clock = Callable[[], int]


class FrameSource(Protocol):
    """Delivers frames, stamped at capture, until it ends or is told to stop."""

    @property
    def rate_hz(self) -> float:
        """Frames per second of motion: at this rate they were sampled, however fast they are played."""

    @property
    def body_parts(self) -> Sequence[str]:
        """Names of what the rows of a frame's content are, if the content is positions."""

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """The frames, each when it is due; ends soon after `stop` is set."""


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """Plays recordings one after the other, whole and never ahead of time.

    Frame i is captured at start + i / rate / speed; without `start_ns` that is now. speed 0: no waiting, and the
    time of capture is the time of playing, which is what ever faster playing comes to. When the observer is
    slower than the motion, frames come late and none is left out. After the last frame nothing is held: it ends.
    """

    archive_parts: tuple[str, ...]
    recordings: Sequence[Recording]
    speed: float = 1.0
    loop: bool = False
    start_ns: int | None = None
    clock: Clock = time.time_ns

    @property
    def rate_hz(self) -> float:
        """Frames per second of motion, as the first recording was sampled: what a model must be told."""
        return self.recordings[0].rate_hz

    @property
    def body_parts(self) -> tuple[str, ...]:
        """The archive's body parts, rows of `Frame.content`."""
        return self.archive_parts

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Each frame when it is due."""
        due_ns = self.clock() if self.start_ns is None else self.start_ns
        motion_ns = 0
        for recording in itertools.cycle(self.recordings) if self.loop else self.recordings:
            for i, positions in enumerate(recording.positions):
                captured_ns = self._wait(due_ns + self._offset_ns(i, recording), stop)
                if captured_ns is None:
                    return
                yield Frame(captured_ns, positions.astype(float), motion_ns + round(i * SECOND_NS / recording.rate_hz))
            due_ns += self._offset_ns(len(recording.positions), recording)
            motion_ns += round(len(recording.positions) * SECOND_NS / recording.rate_hz)

    def _offset_ns(self, frame: int, recording: Recording) -> int:
        return round(frame * SECOND_NS / recording.rate_hz / self.speed) if self.speed else 0

    def _wait(self, due_ns: int, stop: threading.Event) -> int | None:
        """The time of capture of the frame that is due then; None when told to stop."""
        while not stop.is_set():
            now_ns = self.clock()
            if now_ns >= due_ns:
                return due_ns if self.speed else now_ns
            stop.wait((due_ns - now_ns) / SECOND_NS)
        return None


def open_source(scene: Scene, observer: str, environment: Mapping[str, str] = os.environ) -> RecordedMotion:
    """The source that the scene file names for `observer`.

    Raises BadInput for an unknown observer or kind of source, a recording that is not there, and a bad archive.
    """
    section = scene.observer(observer)
    place = scene.place(section.source)
    if place.suffix != ".npz":
        raise BadInput(
            f"observers.{observer}.source = {section.source!r}: unknown kind of source; known: a motion archive (.npz)"
        )
    archive = read_archive(place)
    chosen = _chosen(archive, section.recording, f"observers.{observer}.recording", place)
    start_ns = _start_ns(environment.get(PLAYBACK_START))
    return RecordedMotion(archive.body_parts, chosen, section.speed, section.loop, start_ns)


def _chosen(archive: MotionArchive, which: int | Literal["all"], key: str, place: Path) -> Sequence[Recording]:
    if which == "all":
        return archive.recordings
    if which >= len(archive.recordings):
        raise BadInput(f'{key} = {which}: {place} has recordings 0 to {len(archive.recordings) - 1}; or "all"')
    return archive.recordings[which : which + 1]


def _start_ns(text: str | None) -> int | None:
    if not text:
        return None
    if not text.isdecimal():
        raise BadInput(f"{PLAYBACK_START} = {text!r}: nanoseconds since 1970 are expected, as a whole number")
    return int(text)
