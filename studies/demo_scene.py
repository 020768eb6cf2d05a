"""The files of a demo: a performance, one model per corner, a scene file."""

import socket
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from common.errors import LabanmeshError
from common.parallel import cores, run_parts
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.learn import learn_view
from observer.model.model_file import write_model
from observer.motion.archive import MotionArchive, Recording, resample
from observer.motion.archive_file import write_archive
from observer.tracking.camshift import CamshiftTracker
from studies.demo_films import FILM_SIZE_PX, RATES_HZ, FilmedCorner, FilmRate, film_performance
from studies.output_files import make_folder, write_text
from studies.performer import MOVEMENTS, PEOPLE, perform, perform_continuously

DEMO_CORNERS = {
    "front-left": "yaw:315,pitch:20",
    "front-right": "yaw:35,pitch:25",
    "back-right": "yaw:135,pitch:45",
    "back-left": "yaw:225,pitch:45",
}
"""The four observers: ids as seen from the performer, and views from high in the corners, as cameras hang.

At the performer's height two opposite observers would see mirror images and always agree. Those behind look down more
steeply: from 20 degrees the body hides the hands for half of the time, and one movement more stays undecided. The right
one in front stands nearer to the middle: from 45 degrees camshift often loses a hand at the begin, and where the first
pictures come late, as on one core, the first two movements stay undecided (docs/results/notebook.md).
"""
LARGE_PX = (640, 480)
"""Of pictures from the front in which a face is found that was too small in those of FILM_SIZE_PX."""
PREVIEWED = "front-left"
"""The observer whose view is filmed with the tracks drawn in."""
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class Performance:
    """The recording that is performed, and the recordings that the observers learn from."""

    title: str
    stream: Recording
    learned: MotionArchive
    vocabulary: Vocabulary


def synthetic_performance(seed: int) -> Performance:
    """The SYNTHETIC performer: observers learn from three people and judge the fourth."""
    *others, last = PEOPLE
    title = (
        f"SYNTHETIC performer (a kinematic model, no recorded person): person {last}; models learned from the others"
    )
    stream = perform_continuously(last, MOVEMENTS, seed=seed)
    return Performance(title, stream, perform(others, trials=8, seed=seed), Vocabulary(MOVEMENTS, "the paper's eight"))


def write_demo(
    performance: Performance, folder: Path, progress: Progress, pixels: bool = True
) -> tuple[Path, FilmRate | None]:
    """Write performance, models, scene file and films into `folder`; returns the scene file and the films' rate.

    pixels: the observers track films of virtual cameras with camshift, with a skin histogram learned from the face as
    seen from the front; otherwise there are no films and they receive the projected positions of hands and head.
    Raises BadInput where the folder cannot be written.
    """
    make_folder(folder, "--output")
    parts, stream = performance.learned.body_parts, replace(performance.stream, trial="demo")
    write_archive(folder / "performance.npz", MotionArchive(parts, (stream,)))
    learn = partial(_learn_corner, performance=performance, folder=folder)
    run_parts(learn, list(DEMO_CORNERS), cores(), partial(progress, "learning one model per corner"))
    scene = folder / "scene.toml"
    write_text(scene, _scene_file(performance, pixels), "--output")
    if not pixels:
        return scene, None
    _save_skin(performance, folder / "skin.npz")
    corners = [
        FilmedCorner(corner, parts, stream, view, folder / f"{corner}.mp4", seed=n)
        for n, (corner, view) in enumerate(DEMO_CORNERS.items())
    ]
    return scene, film_performance(corners, scene, progress)


def _learn_corner(corner: str, performance: Performance, folder: Path) -> None:
    provenance = {"archive": performance.title}
    view = parse_view(DEMO_CORNERS[corner])
    model = learn_view(performance.learned, view, performance.vocabulary, provenance=provenance)
    write_model(folder / f"{corner}.model", model)


def _save_skin(performance: Performance, file: Path) -> None:
    """Save the skin as `labanmesh camera look --save-skin` does from the door: corner cameras see no frontal face.

    The skin is learned from the whole performance: from the first face alone, it may have colours of the room, too, and
    a camera from which the person stands before these finds no head.
    """
    stream = resample(performance.stream, RATES_HZ[0])
    camera = FilmedCorner("front", performance.learned.body_parts, stream, "door", file, 0)
    for size_px in (FILM_SIZE_PX, LARGE_PX):
        tracker = CamshiftTracker()
        for frame in camera.frames(size_px):
            tracker.update(frame)
        if tracker.skin is not None:
            tracker.skin.save(file)
            return
    raise LabanmeshError(f"{performance.title}: no face detected from the front; labanmesh demo --no-pixels needs none")


def _scene_file(performance: Performance, pixels: bool) -> str:
    labels = ", ".join(f'"{label}"' for label in performance.vocabulary.labels)
    lines = [
        "# Written by labanmesh demo: four observers in the corners and one fusion service on this machine.",
        f"# {performance.title}.",
        'scene = "demo"',
        f"vocabulary = [{labels}]",
        f'vocabulary_name = "{performance.vocabulary.name}"',
        "",
        "[mesh]",
        f'endpoint = "tcp/127.0.0.1:{free_port()}"',
        "",
        "[fusion]",
        # Two of four cameras see the performer from behind: the two that see the hands must be able to decide.
        f"quorum = {len(DEMO_CORNERS) // 2 if pixels else len(DEMO_CORNERS) // 2 + 1}",
    ]
    for corner, view in DEMO_CORNERS.items():
        source = f"{corner}.mp4" if pixels else "performance.npz"
        lines += ["", f"[observers.{corner}]", f'source = "{source}"', f'view = "{view}"', f'model = "{corner}.model"']
        if pixels:
            lines += ['tracker = "camshift"', 'skin = "skin.npz"']
    return "\n".join(lines) + "\n"


def free_port() -> int:
    """A free port of this machine."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
