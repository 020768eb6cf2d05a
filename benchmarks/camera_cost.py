"""`python -m benchmarks.camera_cost`: what one observer with a camera costs, by tracker and by what the camera sees.

Each row is a real `labanmesh observe` process that plays a film of 640x480 pictures at 30 Hz in real time, as a camera
would deliver them; reading the film is included. The films are made of wave_webcam (LABANMESH_DATA) and kept in a
folder: a person who waves, who stands and shifts about, who keeps still, and the room beside the person. The originals
have 10 Hz; pictures in between are mixed of their neighbours, each has sensor noise of its own, and a film runs
forwards, then backwards, so that it can loop without a jump.
"""

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

from benchmarks.clips.learning import THE_FOUR, Learning, chosen_labels
from benchmarks.clips.material import WEBCAM, recordings
from benchmarks.command_line import markdown_table, recordings_folder, run_command
from benchmarks.observer_process import await_first, observing
from benchmarks.timing import cpu_seconds, resident_bytes
from common.command_options import takes_options
from common.errors import BadInput
from common.text import split_list
from observer.camera.files import Video
from observer.model.model_file import write_model
from observer.model.registry import DEFAULT_MODEL
from observer.tracks import Picture, Size

FILMS = Path("build/camera_cost")
SIZE: Size = (640, 480)
RATE_HZ, BETWEEN = 30, 3
"""The films' rate, and how many of their pictures are made of one original."""
NOISE = 2.0
"""Standard deviation of the sensor noise, grey levels of 255."""
PICTURES = 600
"""Of a film in which nothing moves."""
BESIDE = (0.26, 0.62)
"""Where the person stands, shares of the picture's width: the room is what is left and right of it."""
FIRST_S, SETTLE_S = 60.0, 8.0
"""Longest wait for the first posterior; how long the tracker has to find out that nobody moves."""
HEAD = ("tracker", "in the picture", "share of a core", "memory", "start to first posterior", "posteriors a second")


@dataclass(frozen=True, slots=True)
class CameraCostOptions:
    """As typed on the command line."""

    tracker: Annotated[str, typer.Option(help="Trackers, separated by commas.")] = "mediapipe,camshift"
    shows: Annotated[str, typer.Option(help="moving, standing, still, nobody.")] = "moving,standing,still,nobody"
    seconds: Annotated[float, typer.Option(help="How long each process is watched.")] = 20.0
    films: Annotated[Path, typer.Option(help="Folder of films and model; those missing are written there.")] = FILMS
    setting: Annotated[list[str] | None, typer.Option(help="KEY=VALUE of [observers.ID]; may be repeated.")] = None


@takes_options
def camera_cost(options: CameraCostOptions) -> None:
    """Print the share of a core, the memory and the start of one observer, for trackers and situations.

    LABANMESH_DATA names the folder of recordings. The tracker mediapipe needs mediapipe (.venv-mediapipe).

    Example: python -m benchmarks.camera_cost --tracker mediapipe --shows moving,nobody --setting max_hz=8
    """
    data = recordings_folder()
    options.films.mkdir(parents=True, exist_ok=True)
    rows = []
    for shows in split_list("--shows", options.shows):
        film = film_of(shows, data, options.films)
        for tracker in split_list("--tracker", options.tracker):
            cost = watched(film, model_file(data, options.films), tracker, options)
            rows.append((tracker, shows, *cost.cells))
            print(*rows[-1], sep="  ", file=sys.stderr, flush=True)
    print(markdown_table(HEAD, rows, left=2))


@dataclass(frozen=True, slots=True)
class CameraCost:
    """share: CPU seconds per second, all threads. memory_mb: resident at the end. start_s: to the first posterior."""

    share: float
    memory_mb: float
    start_s: float
    posteriors_hz: float

    @property
    def cells(self) -> tuple[str, ...]:
        """As in the table."""
        return f"{self.share:.1%}", f"{self.memory_mb:.0f} MB", f"{self.start_s:.1f} s", f"{self.posteriors_hz:.1f}"


def watched(film: Path, model: Path, tracker: str, options: CameraCostOptions) -> CameraCost:
    """Measure one observer on a film; raises LabanmeshError if it publishes nothing."""
    settings = [f'tracker = "{tracker}"', *(setting.replace("=", " = ", 1) for setting in options.setting or [])]
    begun_s = time.monotonic()
    with observing(film, model, settings) as (process, inbox):
        await_first(inbox, FIRST_S)
        start_s = time.monotonic() - begun_s
        time.sleep(SETTLE_S)
        inbox.take(0)
        from_s, spent_s = time.monotonic(), cpu_seconds(process)
        time.sleep(options.seconds)
        seconds = time.monotonic() - from_s
        share = (cpu_seconds(process) - spent_s) / seconds
        return CameraCost(share, resident_bytes(process) / 2**20, start_s, len(inbox.take(0)) / seconds)


def model_file(data: Path, folder: Path) -> Path:
    """The default model of four movements of Florence 3D Actions from the front; learned once."""
    path = folder / "four.model"
    if not path.exists():
        archive = recordings(data)
        write_model(path, Learning(archive, chosen_labels(archive, THE_FOUR), DEFAULT_MODEL, {}).model("", "door"))
    return path


def film_of(shows: str, data: Path, folder: Path) -> Path:
    """The film `moving`, `standing`, `still` or `nobody`; made once."""
    makers: dict[str, Callable[[], Iterator[Picture]]] = {
        "moving": lambda: there_and_back(data / WEBCAM / "wave.mp4"),
        "standing": lambda: there_and_back(data / WEBCAM / "stand.mp4"),
        "still": lambda: repeat(fitted(first_picture(data / WEBCAM / "stand.mp4")), PICTURES),
        "nobody": lambda: repeat(empty_room(data / WEBCAM), PICTURES),
    }
    if shows not in makers:
        raise BadInput(f"--shows {shows!r}: unknown; known: {', '.join(makers)}")
    path = folder / f"{shows}.mp4"
    if not path.exists():
        write_film(path, makers[shows]())
    return path


def there_and_back(film: Path) -> Iterator[Picture]:
    """The pictures of a film with BETWEEN - 1 mixed ones after each, forwards and backwards."""
    originals = [fitted(picture) for picture in Video.open(film).pictures()]
    for one, other in zip(
        [*originals, *originals[::-1]], [*originals[1:], *originals[::-1], originals[0]], strict=True
    ):
        for part in range(BETWEEN):
            share = part / BETWEEN
            yield np.asarray(cv2.addWeighted(one, 1 - share, other, share, 0), np.uint8)


def first_picture(film: Path) -> Picture:
    """The first picture of a film."""
    return next(Video.open(film).pictures())


def empty_room(folder: Path) -> Picture:
    """The room beside the person: the left part of one film's first picture and the right part of the other's."""
    stands, waves = (first_picture(folder / name) for name in ("stand.mp4", "wave.mp4"))
    left, right = (round(share * stands.shape[1]) for share in BESIDE)
    parts = np.hstack([stands[:, :left], waves[:, right:]])
    return np.asarray(cv2.resize(parts, SIZE, interpolation=cv2.INTER_AREA), np.uint8)


def fitted(picture: Picture) -> Picture:
    """The picture in the middle of one of SIZE, as large as fits; beside it there is grey."""
    scale = min(SIZE[0] / picture.shape[1], SIZE[1] / picture.shape[0])
    scaled = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    wide, high = SIZE[0] - scaled.shape[1], SIZE[1] - scaled.shape[0]
    edges = (high // 2, high - high // 2, wide // 2, wide - wide // 2)
    return np.asarray(cv2.copyMakeBorder(scaled, *edges, cv2.BORDER_CONSTANT, value=(128, 128, 128)), np.uint8)


def write_film(path: Path, pictures: Iterator[Picture]) -> None:
    """Write the pictures with noise, as MPEG-4 at RATE_HZ."""
    random = np.random.default_rng(0)
    noises = [random.normal(0, NOISE, (SIZE[1], SIZE[0], 3)).astype(np.int16) for _ in range(7)]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, SIZE)
    for number, picture in enumerate(pictures):
        noisy = picture.astype(np.int16) + noises[number % len(noises)]
        writer.write(np.clip(noisy, 0, 255).astype(np.uint8))
    writer.release()


if __name__ == "__main__":
    sys.exit(run_command(camera_cost, "camera_cost"))
