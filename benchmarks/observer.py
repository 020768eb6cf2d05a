"""What one observer process costs: share of a core, memory, time to its first posterior, bytes per second.

`labanmesh observe` watches a film of a recorded person, 1280x720 at 30 frames per second, in real time, with a model of
all movements, and publishes to a subscriber here. Floors:
- share of a core: reading the film, and the plain OpenCV calls on whole pictures (observer_steps.py), as often.
- memory, first posterior: a bare interpreter that has loaded the same libraries and read a picture of the film.
- bytes: the numbers of a posterior in single precision, without names, ids and types.
"""

import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import cv2
import numpy as np

from benchmarks.bare_zenoh import TIMEOUT_S
from benchmarks.observer_process import await_first, observing
from benchmarks.observer_steps import FACINGS, RATE_HZ, halves, learned, plain_calls, recorded
from benchmarks.timing import BenchmarkRow, cpu_seconds, resident_bytes, row
from common.wire import encode
from observer.effort.reader import FacetReader
from observer.geometry.views import parse_view
from observer.model.base import MovementModel
from observer.model.model_file import write_model
from observer.motion.archive import MotionArchive, resample
from observer.motion.playback import RecordedMotion
from observer.motion.projected import ProjectedTracker, frames_of
from observer.prepared_tracks import Resampler
from observer.rendering.scenery import Scenery
from observer.rendering.virtual_camera import VirtualCamera
from observer.runtime.pipeline import Observer, PosteriorEncoder
from observer.runtime.send_on_change import SendOnChange
from observer.tracks import Frame
from studies.trials import strung

SIZE = (1280, 720)
FILM_S = 10.0
SETTLE_S = 4.0
WATCH_S = 10.0
STARTS = 7
MODEL = "bench.model"
STREAM_RECORDINGS = 8
NOW_NS = 1_800_000_000_000_000_000
"""A present-day time: its size on the wire counts."""
BARE = (
    "import time, sys, numpy, msgpack, zenoh, pydantic, typer, cv2; cv2.VideoCapture(sys.argv[1]).read();"
    "print(time.process_time(), [line.split()[1] for line in open('/proc/self/status') if line.startswith('VmRSS')][0])"
)
UNLEARNED = 0.05
"""P(none of the movements), as from a calibrated model."""
FIXED = 8 + 8 + 4
"""Bytes of the two times and the sequence number of a posterior."""


@dataclass(frozen=True, slots=True)
class ProcessCost:
    """share: of one core, all threads; memory_mb: resident at the end."""

    share: float
    memory_mb: float


@dataclass(frozen=True, slots=True)
class StartCost:
    """Seconds, and processor seconds, from the start of a process; memory_mb: where measured."""

    seconds: float
    cpu_s: float
    memory_mb: float = 0.0


def rows(data: Path | None, watch_s: float = WATCH_S, starts: int = STARTS) -> Iterator[BenchmarkRow]:
    """Two rows for each of two models, two for the start, and the bytes."""
    train, test = halves(recorded(data))
    person = test.recordings[0].subject
    own = [r for r in test.recordings if r.subject == person][:STREAM_RECORDINGS]
    stream = resample(strung(own, np.random.default_rng(0))[0], RATE_HZ)
    models = {"": learned("phase", train), f", {FACINGS} facings": learned("phase", train, FACINGS)}
    with tempfile.TemporaryDirectory() as place:
        film = Path(place) / "person.avi"
        pictures = filmed(MotionArchive(test.body_parts, (stream,)), film)
        bare = _bare_start(film, starts)
        for name, model in models.items():
            cost = _watched(Path(place), film, model, watch_s)
            label = f"an observer, 1280x720 at 30 Hz{name}"
            yield row(f"{label}, share of a core", 100 * cost.share, 100 * _plain_share(film, pictures), "%", 1)
            yield row(f"{label}, memory", cost.memory_mb, bare.memory_mb, "MB", 1)
        ours = [_start(Path(place), film) for _ in range(starts)]
        name = "start to first posterior"
        yield row(name, median(start.seconds for start in ours), bare.seconds, "s", starts)
        yield row(f"{name}, processor time", median(start.cpu_s for start in ours), bare.cpu_s, "s", starts)
    yield from byte_rows(MotionArchive(test.body_parts, (stream,)), models)


def filmed(archive: MotionArchive, film: Path, seconds: float = FILM_S) -> list[Frame]:
    """Write a virtual camera's noisy, cluttered film of the first recording; returns its last pictures."""
    motion = RecordedMotion(archive.body_parts, archive.recordings, speed=0, clock=lambda: 0)
    camera = VirtualCamera(motion, parse_view("door"), SIZE, Scenery(background="cluttered", noise=3.0))
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"MJPG"), RATE_HZ, SIZE)
    last: list[Frame] = []
    for number, frame in enumerate(camera.frames(threading.Event())):
        if number >= seconds * RATE_HZ:
            break
        writer.write(frame.content)
        last = [*last[-29:], frame]
    writer.release()
    return last


def _plain_share(film: Path, pictures: list[Frame]) -> float:
    """Processor time of reading and of the plain calls per second of film."""
    cv2.setNumThreads(1)
    capture, frames = cv2.VideoCapture(str(film)), 0
    begun_s = time.process_time()
    while capture.read()[0]:
        frames += 1
    read_s = (time.process_time() - begun_s) / max(frames, 1)
    work = plain_calls(pictures)
    begun_s = time.process_time()
    for _ in range(frames):
        work()
    return (read_s + (time.process_time() - begun_s) / max(frames, 1)) * RATE_HZ


def _bare_start(film: Path, starts: int) -> StartCost:
    """Medians of an interpreter with the libraries alone."""
    costs = []
    for _ in range(starts):
        begun_s = time.monotonic()
        process = subprocess.run([sys.executable, "-c", BARE, str(film)], capture_output=True, text=True, check=True)  # noqa: S603
        seconds = time.monotonic() - begun_s
        cpu_s, size_kb = process.stdout.split()
        costs.append(StartCost(seconds, float(cpu_s), int(size_kb) / 1024))
    seconds, spent_s = median(cost.seconds for cost in costs), median(cost.cpu_s for cost in costs)
    return StartCost(seconds, spent_s, median(cost.memory_mb for cost in costs))


def _watched(place: Path, film: Path, model: MovementModel, watch_s: float) -> ProcessCost:
    write_model(place / MODEL, model)
    with observing(film, place / MODEL) as (process, inbox):
        await_first(inbox, TIMEOUT_S)
        time.sleep(SETTLE_S if watch_s == WATCH_S else 0.0)
        begun_s, spent_s = time.monotonic(), cpu_seconds(process)
        time.sleep(watch_s)
        share = (cpu_seconds(process) - spent_s) / (time.monotonic() - begun_s)
        return ProcessCost(share, resident_bytes(process) / 2**20)


def _start(place: Path, film: Path) -> StartCost:
    """Start a real observer until its first posterior."""
    begun_s = time.monotonic()
    with observing(film, place / MODEL) as (process, inbox):
        await_first(inbox, TIMEOUT_S)
        return StartCost(time.monotonic() - begun_s, cpu_seconds(process))


def byte_rows(archive: MotionArchive, models: dict[str, MovementModel]) -> Iterator[BenchmarkRow]:
    """Bytes per second of a person's stream in one view at 30 Hz, sent for each frame or on change."""
    plain, turning = models.values()
    frames = list(frames_of(archive.recordings[0], NOW_NS))
    for name, model, facets, heartbeat_s in (
        ("each frame", plain, False, None),
        ("on change", plain, False, 0.1),
        ("each frame, with Shape", plain, True, None),
        ("on change, with Shape", plain, True, 0.1),
        (f"each frame, {FACINGS} facings", turning, False, None),
        (f"on change, {FACINGS} facings", turning, False, 0.1),
    ):
        sent, floor = sent_bytes(archive, frames, model, facets, heartbeat_s)
        seconds = len(frames) / RATE_HZ
        yield row(f"bytes a second, {name}", sent / seconds, floor / seconds, "B", len(frames))


def sent_bytes(
    archive: MotionArchive, frames: Sequence[Frame], model: MovementModel, facets: bool, heartbeat_s: float | None
) -> tuple[int, int]:
    """The bytes sent for the frames, and the bytes of the numbers alone for every frame."""
    header = model.header
    reader = FacetReader(header.body_parts, header.rate_hz) if facets else None
    tracker = ProjectedTracker(parse_view("door"), archive.body_parts, header.body_parts)
    observer = Observer(tracker, model, None, Resampler(header.rate_hz), reader)
    send_on_change = None if heartbeat_s is None else SendOnChange(heartbeat_s)
    encoder, sent, floor = PosteriorEncoder(header.vocabulary, "bench0"), 0, 0
    for frame in frames:
        posterior = replace(observer.step(frame), unlearned=UNLEARNED)
        if send_on_change is None or send_on_change.should_send(posterior, frame.captured_ns):
            sent += len(encode(encoder.encode(posterior, frame.captured_ns, frame.captured_ns + 1)))
        facing = 0 if posterior.facing is None else posterior.facing.size
        floor += 4 * (len(posterior.p) + 2 + sum(map(len, posterior.facets.values()))) + FIXED + facing
    return sent, floor
