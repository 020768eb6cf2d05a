"""The files of a demo: a performance, one model per corner, a scene file."""

import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event

import numpy as np

from common.errors import BadInput, LabanmeshError
from common.text import plural
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.learn import learn_view
from observer.model.model_file import write_model
from observer.motion.archive import MotionArchive, Recording, movements_in, subjects_in
from observer.motion.archive_file import write_archive
from observer.motion.playback import RecordedMotion
from observer.rendering.scenery import Scenery
from observer.rendering.virtual_camera import VirtualCamera
from observer.tracking.camshift import CamshiftTracker
from studies.output_files import make_folder, write_text
from studies.performer import MOVEMENTS, PEOPLE, perform, perform_continuously
from studies.trials import strung

CORNERS = {
    "front-left": "yaw:315,pitch:20",
    "front-right": "yaw:45,pitch:20",
    "back-right": "yaw:135,pitch:20",
    "back-left": "yaw:225,pitch:20",
}
"""The four observers: ids as seen from the performer, and views from high in the corners, as cameras hang.

At the performer's height two opposite observers would see mirror images and always agree.
"""
RATE_HZ, BACKGROUND, NOISE = 30.0, "cluttered", 3.0
"""Of the virtual cameras' pictures."""
PREVIEW = "front-left.mp4"
"""The film of the first corner."""
MOST_MOVEMENTS = 10
"""Movements of a recorded person that fit into a demo of under 90 s."""
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


def recorded_performance(archive: MotionArchive, name: str, subject: str | None, seed: int) -> Performance:
    """One person of an archive, judged by models of the others; recordings are strung together with rest between.

    Raises BadInput for an unknown person and for an archive of a single person.
    """
    subjects = subjects_in(archive.recordings)
    chosen = subject or subjects[-1]
    if chosen not in subjects:
        raise BadInput(f"--subject {chosen!r}: not in {name}; it has {', '.join(subjects)}")
    if len(subjects) < 2:
        raise BadInput(f"--motion {name}: shows 1 person; the observers learn from others, so it needs at least 2")
    others = tuple(r for r in archive.recordings if r.subject != chosen)
    learned = MotionArchive(archive.body_parts, tuple(movements_in(MotionArchive(archive.body_parts, others))))
    labels = tuple(dict.fromkeys(r.label for r in learned.recordings if r.label))
    stream = _stream_of([r for r in archive.recordings if r.subject == chosen], labels, seed)
    others_text = plural(len(subjects) - 1, "other")
    title = f"recorded person {chosen} of {name}; models learned from {others_text}"
    return Performance(title, stream, learned, Vocabulary(labels))


def _stream_of(own: Sequence[Recording], labels: Sequence[str], seed: int) -> Recording:
    """The person's continuous recording if there is one, else one recording each of up to ten movements."""
    whole = [r for r in own if r.spans]
    if whole:
        return whole[0]
    rng = np.random.default_rng([seed, 3])
    first = {r.label: r for r in own if r.label in labels}
    picked = rng.permutation(sorted(first))[:MOST_MOVEMENTS]
    return strung([first[str(label)] for label in picked], rng)[0]


def write_demo(performance: Performance, folder: Path, progress: Progress, pixels: bool = True) -> Path:
    """Write performance, models and scene file into `folder`; returns the scene file.

    pixels: the observers track pictures of virtual cameras with camshift, with a skin histogram learned from the face
    as seen from the front; otherwise they receive the projected positions of hands and head. Raises BadInput where
    the folder cannot be written.
    """
    make_folder(folder, "--output")
    stream = replace(performance.stream, trial="demo")
    write_archive(folder / "performance.npz", MotionArchive(performance.learned.body_parts, (stream,)))
    for n, (corner, view) in enumerate(CORNERS.items()):
        provenance = {"archive": performance.title}
        model = learn_view(performance.learned, parse_view(view), performance.vocabulary, provenance=provenance)
        write_model(folder / f"{corner}.model", model)
        progress("learning one model per corner", n + 1, len(CORNERS))
    if pixels:
        _save_skin(performance, folder / "skin.npz")
    scene = folder / "scene.toml"
    write_text(scene, _scene_file(performance, pixels), "--output")
    return scene


def _save_skin(performance: Performance, file: Path) -> None:
    """As `labanmesh look --view door --save-skin`: the corner cameras see no frontal face to learn the skin from."""
    parts, stream = performance.learned.body_parts, performance.stream
    motion = RecordedMotion(parts, (stream,), speed=0)
    tracker = CamshiftTracker()
    for frame in VirtualCamera(motion, parse_view("door"), scenery=Scenery(BACKGROUND, NOISE)).frames(Event()):
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
        f"quorum = {len(CORNERS) // 2 if pixels else len(CORNERS) // 2 + 1}",
    ]
    for n, (corner, view) in enumerate(CORNERS.items()):
        lines += ["", f"[observers.{corner}]", 'source = "performance.npz"', f'view = "{view}"']
        lines += [f'model = "{corner}.model"']
        if pixels:
            lines += ['tracker = "camshift"', 'skin = "skin.npz"', f"rate_hz = {RATE_HZ:g}"]
            lines += [f'preview = "{PREVIEW}"'] * (n == 0)
            lines += [f"[observers.{corner}.virtual]", f'background = "{BACKGROUND}"']
            lines += [f"noise = {NOISE}", f"seed = {n}"]
    return "\n".join(lines) + "\n"


def free_port() -> int:
    """A port of this machine that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
