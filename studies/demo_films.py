"""The demo's pictures: one film per corner, rendered before the performance, at a rate that this machine can track."""

import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from common import SECOND_NS
from common.config import read_scene
from common.parallel import run_parts
from common.wire import encode
from observer.camera.files import write_film
from observer.geometry.views import parse_view
from observer.model.model_file import read_model
from observer.motion.archive import Recording, resample
from observer.motion.playback import RecordedMotion, StartBarrier
from observer.prepared_tracks import Resampler
from observer.preview.small_picture import STATE_COLOUR, Sighting, small_picture, write_line
from observer.rendering.scenery import Scenery
from observer.rendering.virtual_camera import VirtualCamera
from observer.runtime.pipeline import Observer, PosteriorEncoder
from observer.runtime.scene_inputs import ObserverInputs, open_inputs
from observer.tracks import Frame, Picture, Size, State, Tracks
from studies.fusion_engine import FusionEngine, step
from studies.settings import Progress

SCENERY = Scenery("cluttered", noise=3.0)
"""What stands around the performer, and the noise of the cameras."""
FILM_SIZE_PX: Size = (320, 240)
"""Of the films; in larger ones camshift finds no more of the performer."""
RATES_HZ = (15.0, 10.0)
"""Pictures a second of the films, best first: that of the models, and one for slow machines, with which camshift loses
hands more often and two movements of eight stay undecided. With 20 or 30 a second no more are right."""
MOST_SHARE = 0.7
"""The observers' films may take this share of what was measured: reading, sending and showing need the rest, and what
else runs on the machine."""
MEETINGS = ("measuring", "filming")
"""At which the processes that film wait for each other."""
SAMPLE_S, MEASURE_S = 2.0, 1.0
"""Seconds of the performance on which the machine is measured, and how long the measurement takes."""


@dataclass(frozen=True, slots=True)
class FilmRate:
    """The chosen rate. tracked_per_s: pictures that all observers together can track, when they do nothing else."""

    rate_hz: float
    tracked_per_s: float
    cameras: int

    @classmethod
    def within(cls, tracked_per_s: float, cameras: int) -> "FilmRate":
        """The best of RATES_HZ that takes at most MOST_SHARE of the machine, or the last one."""
        choices = [cls(rate_hz, tracked_per_s, cameras) for rate_hz in RATES_HZ]
        return next((choice for choice in choices if choice.share <= MOST_SHARE), choices[-1])

    @property
    def share(self) -> float:
        """The share of the machine that the films take; above MOST_SHARE it is too slow."""
        return self.cameras * self.rate_hz / max(self.tracked_per_s, 1e-9)

    @property
    def text(self) -> str:
        """The measurement and the chosen rate, in one line."""
        width, height = FILM_SIZE_PX
        line = (
            f"this machine tracks about {self.tracked_per_s:.0f} pictures a second in {self.cameras} processes; "
            f"the demo uses {self.cameras} x {self.rate_hz:g} pictures of {width}x{height} a second "
            f"({self.share:.0%} of that)"
        )
        return line + "; TOO SLOW: try labanmesh demo --no-pixels" * (self.share > MOST_SHARE)


@dataclass(frozen=True, slots=True, eq=False)
class FilmedCorner:
    """A virtual camera: what it films, from where, and into which file. seed: of its background and its noise."""

    name: str
    body_parts: tuple[str, ...]
    stream: Recording
    view: str
    file: Path
    seed: int

    def frames(self, size_px: Size = FILM_SIZE_PX) -> Iterator[Frame]:
        """All pictures, as fast as possible."""
        motion = RecordedMotion(self.body_parts, (self.stream,), speed=0)
        return VirtualCamera(motion, parse_view(self.view), size_px, SCENERY, self.seed).frames(threading.Event())


def film_performance(corners: Sequence[FilmedCorner], scene_file: Path, progress: Progress) -> FilmRate:
    """Measure how many pictures a second the scene's observers can track here, write films at that rate, and return it.

    The observers of `scene_file` play these films. One process for each measures, all at once, and films.
    """
    with tempfile.TemporaryDirectory(prefix="labanmesh-") as folder:
        for meeting in MEETINGS:
            (Path(folder) / meeting).mkdir()
            for corner in corners:
                (Path(folder) / meeting / f"{corner.name}.awaited").touch()
        film = partial(_film, scene_file=scene_file, folder=Path(folder), cameras=len(corners))
        done = partial(progress, "measuring this machine, and filming")
        return run_parts(film, corners, len(corners), done)[0]


def _film(corner: FilmedCorner, scene_file: Path, folder: Path, cameras: int) -> FilmRate:
    """Measure on the first seconds, meet the others, and film the whole at the rate that follows from all results."""
    begin, result = (StartBarrier(folder / meeting, corner.name) for meeting in MEETINGS)
    sample = corner.stream.positions[: round(SAMPLE_S * corner.stream.rate_hz)]
    _write_corner(replace(corner, stream=replace(corner.stream, positions=sample, spans=())), RATES_HZ[0])
    (folder / f"{corner.name}.measured").write_text(str(_tracked_per_s(corner.name, scene_file, begin)))
    result(threading.Event())
    rate = FilmRate.within(sum(float(file.read_text()) for file in folder.glob("*.measured")), cameras)
    _write_corner(corner, rate.rate_hz)
    return rate


def _write_corner(corner: FilmedCorner, rate_hz: float) -> None:
    frames = replace(corner, stream=resample(corner.stream, rate_hz)).frames()
    write_film(corner.file, rate_hz, FILM_SIZE_PX, (frame.content for frame in frames))


def _tracked_per_s(name: str, scene_file: Path, begin: StartBarrier) -> float:
    """Pictures a second that one observer reads, tracks and judges, and fusion after it, while the others do the same.

    Each picture takes as much of fusion as in the performance: one step for each posterior.
    """
    observer, inputs = _observing(scene_file, name, loop=True)
    scene = read_scene(scene_file)
    engine = FusionEngine(scene.scene, list(scene.roster), observer.vocabulary, scene.fusion)
    encoder = PosteriorEncoder(observer.vocabulary, "measured")
    time.sleep(max(begin(threading.Event()) - time.time_ns(), 0) / SECOND_NS)
    end_s, count = time.monotonic() + MEASURE_S, 0
    for frame in inputs.source.frames(threading.Event()):
        message = encoder.encode(observer.step(frame), frame.captured_ns, frame.captured_ns)
        encode(message)
        step(engine, {name: message}, frame.captured_ns)
        count += 1
        if time.monotonic() >= end_s:
            break
    return count / MEASURE_S


def film_tracks(scene_file: Path, name: str, file: Path, progress: Progress) -> None:
    """Make a film of what an observer sees in its own film: the tracks, and its belief."""
    observer, inputs = _observing(scene_file, name)
    parts = inputs.tracker.every_part

    def pictures() -> Iterator[Picture]:
        for n, frame in enumerate(inputs.source.frames(threading.Event()), 1):
            posterior = observer.step(frame)
            tracks = inputs.tracker.all_tracks or Tracks(np.full((len(parts), 2), np.nan))
            picture = small_picture(Sighting(frame.content, tracks, parts, frame.captured_ns), max(FILM_SIZE_PX))
            best = int(posterior.p.argmax())
            belief = f"{observer.vocabulary.labels[best]} {posterior.p[best]:.0%}, at rest {posterior.rest:.0%}"
            write_line(picture, len(parts) + 1, belief, STATE_COLOUR[State.SEEN])
            yield picture
            progress(f"drawing what {name} saw", n, getattr(inputs.source, "count", n))

    write_film(file, inputs.source.rate_hz, FILM_SIZE_PX, pictures())


def _observing(scene_file: Path, name: str, loop: bool = False) -> tuple[Observer, ObserverInputs]:
    """An observer of the scene whose film is played as fast as possible; loop: again and again."""
    scene = read_scene(scene_file)
    section = scene.observer(name).model_copy(update={"speed": 0.0, "loop": loop})
    scene = scene.model_copy(update={"observers": {**scene.observers, name: section}})
    model = read_model(scene.model_file(name))
    inputs = open_inputs(scene, name, model.header.body_parts)
    return Observer(inputs.tracker, model, None, Resampler(model.header.rate_hz)), inputs
