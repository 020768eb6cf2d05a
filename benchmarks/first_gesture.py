"""`python -m benchmarks.first_gesture`: from a clone to the first own gesture recognised, with a film as the camera.

The film is made of wave_webcam: a man who stands, waves one hand, and waves both. It follows the lesson: five takes of
each with rest between, ordinary standing, and then both gestures by turns. The commands are those of
docs/guide/own-movements.md, typed one after the other; their times are printed.
"""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

from benchmarks.command_line import recordings_folder, run_command
from common.errors import BadInput, LabanmeshError
from observer.camera.base import Picture

FILM = "wave_webcam"
RATE_HZ = 10
BEGIN_S, REST_S, TURN_S = 13.0, 12.0, 5.0
TAKES, LIFE_S, TURNS = 5, 45.0, 12
ONE, BOTH = (*range(27, 44), *range(44, 27, -1), *range(27, 44)), tuple(range(60, 100))
"""Pictures of the film in which one hand waves, to and fro, and both."""
STILL = slice(4, 30)
"""Pictures in which the man hardly moves, of another one."""
LABELS = ("wave", "wave_both")
LIMIT_S = 900.0


def first_gesture(
    clone: Annotated[str, typer.Argument(help="The repository to clone: an address or a folder.")],
    folder: Annotated[Path, typer.Argument(help="An empty folder to work in.")],
    minutes: Annotated[float, typer.Option(min=0, max=60, help="Ordinary life in the lesson.")] = 0.5,
) -> None:
    """Clone, install, init, teach; print how long each took, and when the first own gesture was recognised.

    LABANMESH_DATA names the folder of recordings.

    Example: python -m benchmarks.first_gesture . /tmp/first
    """
    data = recordings_folder()
    folder.mkdir(parents=True, exist_ok=True)
    _write_film(data / FILM, folder / "camera.mp4")
    begun_s = time.monotonic()
    home = folder / "labanmesh"
    program = str(home / ".venv-cameras" / "bin" / "labanmesh")
    _timed("git", "clone", "--quiet", clone, str(home))
    _timed("make", "--no-print-directory", "-C", str(home), "install")
    _timed(program, "init", str(folder / "scene.toml"), "--source", str(folder / "camera.mp4"))
    words = ["teach", str(folder / "scene.toml"), *LABELS, "--up", "--no-test", "--background-minutes", str(minutes)]
    recognised_s = _lesson([program, *words])
    print(f"first own gesture recognised {(recognised_s - begun_s) / 60:.1f} minutes after the first of 4 commands")


def _timed(*command: str) -> None:
    begun_s = time.monotonic()
    print("$", *command, flush=True)
    if subprocess.run(command, check=False).returncode:  # noqa: S603 - the commands are ours
        raise LabanmeshError(f"{command[0]} has failed")
    print(f"  {time.monotonic() - begun_s:.0f} s", flush=True)


def _lesson(command: list[str]) -> float:
    """Run the lesson and the view after it until a verdict names a gesture; its time."""
    begun_s, adopted = time.monotonic(), False
    print("$", *command, flush=True)
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)  # noqa: S603 - the command is ours
    try:
        for line in process.stdout or ():
            now_s = time.monotonic()
            print(f"  {now_s - begun_s:5.0f} s  {line}", end="", flush=True)
            adopted = adopted or "from now on" in line
            # As `labanmesh watch` prints it: the time, the kind of message, the label.
            if adopted and line.split()[1:2] == ["verdict"] and line.split()[2] in LABELS:
                return now_s
            if now_s - begun_s > LIMIT_S:
                break
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()
    raise LabanmeshError("no gesture was recognised")


def _write_film(source: Path, target: Path) -> None:
    waving, standing = _pictures(source / "wave.mp4"), _pictures(source / "stand.mp4")
    height, width = waving[0].shape[:2]
    film = cv2.VideoWriter(str(target), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, (width, height))
    rest, life = _standing(standing[STILL]), _standing(standing)
    parts: list[tuple[tuple[int, ...], float]] = [((), BEGIN_S)]
    for taught in (ONE, BOTH):
        parts += TAKES * [(taught, 0.0), ((), REST_S)]
    life_at = len(parts)
    parts += [((), LIFE_S), *([(ONE, 0.0), ((), TURN_S), (BOTH, 0.0), ((), TURN_S)] * TURNS)]
    for number, (gesture, rest_s) in enumerate(parts):
        still = life if number == life_at else rest
        shown = [waving[n] for n in gesture] or [next(still) for _ in range(round(rest_s * RATE_HZ))]
        for picture in shown:
            film.write(_varied(picture, number if gesture else 0))
    film.release()


def _standing(pictures: list[Picture]) -> Iterator[Picture]:
    """For ever to and fro, so that nothing jumps."""
    while True:
        yield from pictures
        yield from reversed(pictures)


def _varied(picture: Picture, number: int) -> Picture:
    """The same gesture from a little farther away and aside, as people never stand twice in one place."""
    height, width = picture.shape[:2]
    scale, aside = 1 - 0.02 * (number % 4), 4.0 * (number % 5 - 2)
    matrix = np.array([[scale, 0, aside + width * (1 - scale) / 2], [0, scale, height * (1 - scale)]])
    return np.asarray(cv2.warpAffine(picture, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE), np.uint8)


def _pictures(path: Path) -> list[Picture]:
    film, pictures = cv2.VideoCapture(str(path)), []
    while (read := film.read())[0]:
        pictures.append(np.asarray(read[1], np.uint8))
    if not pictures:
        raise BadInput(f"{path}: cannot be read")
    return pictures


if __name__ == "__main__":
    sys.exit(run_command(first_gesture, "first_gesture"))
