"""The 16 clips before the camera of a phone's page: `python -m benchmarks.phone_clips [--only 1_1,2_1]`.

Chromium shows each clip as its camera, again and again with a pause in which nobody is there; its page, the server of
phones, the observer and the fusion service are real processes. The measure is the same film, tracked by mediapipe in
Python and judged in this process. LABANMESH_DATA names the folder of recordings; `labanmesh phone --fetch` brings the
page's model.
"""

import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import msgspec
import numpy as np
import typer
from playwright.sync_api import sync_playwright

from benchmarks.clips.judging import judge
from benchmarks.clips.learning import THE_FOUR, Learning, chosen_labels
from benchmarks.clips.material import Clip, centres_in, gesture_clips, pictures_of, recordings, write_clip_camera
from benchmarks.command_line import recordings_folder, run_command
from benchmarks.crowd.trial import stop_process
from benchmarks.timing import free_port
from common import SECOND_NS
from common.config import Scene, read_scene
from common.config_sections import FusionConfig
from common.errors import LabanmeshError
from common.link import Link
from common.messages import VerdictMessage
from common.text import split_list
from common.vocabulary import ABSTAIN
from common.wire import decode
from observer.model.base import MovementModel
from observer.model.model_file import write_model
from observer.model.registry import DEFAULT_MODEL
from observer.motion.importers.florence3d import FLORENCE_HZ
from observer.tracking.mediapipe_pose import TALL_TORSOS
from observer.tracks import BODY_PARTS, Floats

PAUSE = 15
"""Pictures of an empty room before each round: 1.5 s, after which a verdict has ended, and a page still looks often."""
SHOWN = 3
"""Chromium shows a picture of such a film every 33 ms; the clips were taken at 10 Hz."""
START_S = 60.0
NAME = "phone1"
HANDS = [part for part in BODY_PARTS if part.endswith("hand")]


@dataclass(frozen=True, slots=True)
class Seen:
    """What came from the page: times (F,) s, centres (F, P, 2) px of BODY_PARTS, height px; verdicts by their begin."""

    times_s: Floats
    centres: Floats
    height: float
    verdicts: Sequence[tuple[float, str]]

    def rounds(self, seconds: float) -> list[float]:
        """When somebody appeared, of each round that was seen whole."""
        here = self.times_s[np.isfinite(self.centres).any(axis=(1, 2))]
        begins = here[1:][np.diff(here) > PAUSE / FLORENCE_HZ / 2]
        return [float(at_s) for at_s in begins if at_s + seconds + PAUSE / FLORENCE_HZ < self.times_s[-1]]


def labels_of_rounds(verdicts: Sequence[tuple[float, str]], begins: Sequence[float], seconds: float) -> list[str]:
    """The first movement that is named in each round; without one "abstain", or "" without any verdict."""
    own = [[label for at_s, label in verdicts if -0.3 <= at_s - begin < seconds + 1.0] for begin in begins]
    return [next((label for label in labels if label != ABSTAIN), "".join(labels[:1])) for labels in own]


def commonest(labels: Sequence[str]) -> str:
    """The label of most rounds."""
    return max(labels, key=labels.count, default="")


def expected(clip: Clip, centres: Floats, model: MovementModel, rounds: int) -> list[str]:
    """The first verdicts of mediapipe in Python on the same film."""
    nobody = np.full((PAUSE, *centres.shape[1:]), np.nan)
    film = np.concatenate([nobody, *[centres, nobody] * rounds])
    result = judge(clip.name, clip.label, film, FLORENCE_HZ, model, FusionConfig())
    period_s = (len(centres) + PAUSE) / FLORENCE_HZ
    begins = [PAUSE / FLORENCE_HZ + n * period_s for n in range(rounds)]
    return labels_of_rounds([(v.at_s, v.label) for v in result.verdicts], begins, len(centres) / FLORENCE_HZ)


def hands_apart(seen: Seen, centres: Floats, begins: Sequence[float]) -> float:
    """Mean distance of the hands from those of mediapipe in Python, in heights; each round at the best delay."""
    rows, errors = [BODY_PARTS.index(part) for part in HANDS], list[Floats]()
    for begin in begins:
        own = (seen.times_s >= begin) & (seen.times_s < begin + len(centres) / FLORENCE_HZ)
        tries = []
        for delay_s in np.arange(-0.2, 0.2, 0.02):
            frames = np.floor((seen.times_s[own] - begin + delay_s) * FLORENCE_HZ).astype(int)
            there = (frames >= 0) & (frames < len(centres))
            off = np.linalg.norm(seen.centres[own][there][:, rows] - centres[frames[there]][:, rows], axis=2)
            tries.append(off[np.isfinite(off)] / seen.height)
        errors.append(min((each for each in tries if len(each)), key=np.median, default=np.empty(0)))
    together = np.concatenate(errors) if errors else np.empty(0)
    return float(together.mean()) if len(together) else np.nan


@contextmanager
def started(*words: str) -> Iterator[subprocess.Popen[bytes]]:
    """A labanmesh process whose lines can be read."""
    command = [sys.executable, "-P", "-m", "labanmesh", *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)  # noqa: S603 - our verbs
    try:
        yield process
    finally:
        stop_process(process)


def link_of(process: subprocess.Popen[bytes]) -> str:
    """The address with the code, which `labanmesh phone` prints."""
    for line in process.stdout or ():
        if match := re.search(rb"https://\S+#\S+", line):
            return match[0].decode()
    raise LabanmeshError("`labanmesh phone` ended without a code")


def write_film(clip: Clip, path: Path) -> None:
    """The pause and the clip, as a film that Chromium takes for a camera."""
    pictures = list(pictures_of(clip))
    empty = [np.full_like(pictures[0], 128)] * PAUSE
    with path.open("wb") as file:
        for picture in (*empty, *pictures):
            file.write(cv2.imencode(".jpg", picture)[1].tobytes() * SHOWN)


def show(clip: Clip, model: MovementModel, folder: Path, seconds: float) -> Seen:
    """Show the clip to a page for so long."""
    write_model(folder / f"{NAME}.model", model)
    write_clip_camera(folder / "camera.toml")
    write_film(clip, folder / "film.mjpeg")
    file = folder / "scene.toml"
    file.write_text(
        f'scene = "clips"\n[mesh]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n'
        f'[observers.{NAME}]\nsource = "phone"\nview = "camera.toml"\n'
    )
    scene = read_scene(file, {})
    with started("up", str(file)), started("phone", str(file), "--listen", "127.0.0.1:0") as phones:
        link = link_of(phones)
        with Link.open(scene.mesh, "hub") as hub, sync_playwright() as driver:
            words = ["--no-sandbox", "--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream"]
            path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
            film = f"--use-file-for-fake-video-capture={folder / 'film.mjpeg'}"
            browser = driver.chromium.launch(executable_path=path, args=[*words, film])
            page = browser.new_context(ignore_https_errors=True).new_page()
            page.goto(link, timeout=1000 * START_S)
            seen = listen(hub, scene, seconds)
            browser.close()
    return seen


def listen(hub: Link, scene: Scene, seconds: float) -> Seen:
    """Tracks and verdicts, from the first posterior on for so long."""
    tracks, posteriors, verdicts = (
        hub.inbox(key) for key in (scene.keys.tracks(NAME), scene.keys.posterior(), scene.keys.verdict)
    )
    first_s = time.monotonic() + START_S
    while not posteriors.take(0.1):
        if time.monotonic() > first_s:
            raise LabanmeshError(f"no posterior within {START_S:g} s")
    time.sleep(seconds)
    lines = [msgspec.json.decode(arrival.payload) for arrival in tracks.take(0)]
    decided = [decode(VerdictMessage, arrival.payload) for arrival in verdicts.take(0)]
    first = {each.id: each for each in reversed(decided)}
    parts = [line["parts"] for line in lines]
    torsos = [np.subtract(p["neck"][:2], p["pelvis"][:2]) for p in parts if p["neck"] and p["pelvis"]]
    return Seen(
        np.array([line["captured_ns"] / SECOND_NS for line in lines]),
        np.array([[_centre(each[part]) for part in BODY_PARTS] for each in parts]),
        TALL_TORSOS * float(np.median(np.linalg.norm(torsos, axis=1))) if torsos else np.nan,
        sorted((each.began_ns / SECOND_NS, each.label) for each in first.values()),
    )


def _centre(place: list[float] | None) -> list[float]:
    return place[:2] if place is not None and place[2] >= 0.5 else [np.nan, np.nan]


def phone_clips(
    tracks: Annotated[Path, typer.Option(help="Folder of the tracks by mediapipe in Python.")] = Path("build/clips"),
    only: Annotated[str, typer.Option(help="Names of clips, separated by commas; default: all.")] = "",
    rounds: Annotated[int, typer.Option(min=1, help="How often each clip is shown.")] = 5,
) -> None:
    """Print the first movement that is named in each round of each clip, by a phone's page and by mediapipe in Python.

    Example: python -m benchmarks.phone_clips --only 1_1
    """
    data = recordings_folder()
    archive = recordings(data)
    learning = Learning(archive, chosen_labels(archive, THE_FOUR), DEFAULT_MODEL, {})
    tracks.mkdir(parents=True, exist_ok=True)
    same = shown = 0
    for clip in gesture_clips(data):
        if only and clip.name not in split_list("--only", only):
            continue
        model, centres = learning.model(clip.subject, "camera"), centres_in(clip, tracks)
        clip_s = len(centres) / FLORENCE_HZ
        with tempfile.TemporaryDirectory() as folder:
            seen = show(clip, model, Path(folder), (rounds + 2) * (clip_s + PAUSE / FLORENCE_HZ))
        begins = seen.rounds(clip_s)
        own, known = labels_of_rounds(seen.verdicts, begins, clip_s), expected(clip, centres, model, rounds)
        apart = hands_apart(seen, centres, begins)
        same, shown = same + (commonest(own) == commonest(known)), shown + 1
        counts = [", ".join(f"{n} {label or 'none'}" for label, n in Counter(each).items()) for each in (own, known)]
        print(
            f"{clip.name} {clip.label}: page {counts[0]}; Python {counts[1]}; hands {apart:.3f} heights apart",
            flush=True,
        )
    print(f"the same label most often in {same} of {shown} clips")


if __name__ == "__main__":
    sys.exit(run_command(phone_clips, "phone_clips"))
