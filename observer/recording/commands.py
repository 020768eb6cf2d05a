"""The commands `record` and `place`: several calibrated cameras add one recording to a motion archive, or see where the
person stands."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.command_options import takes_options
from common.errors import BadInput
from common.progress import ProgressBar
from common.text import plural, split_list

if TYPE_CHECKING:
    from observer.motion.archive import MotionArchive, Recording


Gate = Annotated[
    float | None,
    typer.Option(
        min=0.1, max=10_000, help="Largest reprojection error that counts, px; default 20, or 8 cm where the person is."
    ),
]


@dataclass(frozen=True, slots=True)
class RecordOptions:
    """The options of `labanmesh camera record`, as they were typed."""

    scene: Annotated[Path, typer.Argument(help="The scene file; its observers with a camera file are recorded.")]
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The motion archive (.npz); an existing one is extended.")
    ]
    subject: Annotated[str, typer.Option(help="The performer.")]
    label: Annotated[str, typer.Option(help="The movement: lower case letters, digits, underscores.")] = ""
    other_motion: Annotated[
        bool,
        typer.Option("--other-motion", help="In place of --label: anything but the movements, for learn --background."),
    ] = False
    trial: Annotated[
        int | None, typer.Option(min=0, max=10**9, help="Number of the trial; by default the next free one.")
    ] = None
    seconds: Annotated[
        float | None, typer.Option(min=0.1, max=86_400, help="Duration; by default until the sources end or Ctrl-C.")
    ] = None
    observers: Annotated[str, typer.Option(help="Only these observers, separated by commas.")] = ""
    rate: Annotated[float, typer.Option(min=1, max=1000, help="Rate of the recording, Hz.")] = 30.0
    gate: Gate = None
    up: Annotated[str, typer.Option(help="The axis of the calibration that points up: x, -x, y, -y, z or -z.")] = "y"
    front: Annotated[str, typer.Option(help="The axis along which the performer faces.")] = "-z"
    trim: Annotated[bool, typer.Option("--trim", help="Cut off the rest before and after the movement.")] = False


@takes_options
def record(options: RecordOptions) -> None:
    """Record one movement with several calibrated cameras, and add its positions in space to a motion archive.

    A single camera, or cameras without calibration, record in a lesson: labanmesh teach.

    Example: labanmesh camera record scene.toml -o mine.npz --label wave --subject anna --seconds 5

    Example: labanmesh camera record scene.toml -o life.npz --other-motion --subject anna --seconds 300
    """
    if bool(options.label) == options.other_motion:
        raise BadInput("--label: name the movement, or give --other-motion for motion that is none; one of them")
    from common.lifecycle import log_to_stderr, stop_on_signals
    from observer.files import require_writable_path
    from observer.motion.archive import MotionArchive
    from observer.motion.archive_file import read_archive, write_archive
    from observer.recording.new_recording import NothingRecorded
    from observer.recording.reconstruction import performer_axes

    log_to_stderr()
    performer_axes(options.up, options.front)
    output = options.output
    require_writable_path(output)
    before = read_archive(output) if output.exists() else None
    if before is not None and before.camera is not None:
        raise BadInput(f"{output}: holds 2-D tracks; choose another file with -o")
    # Ctrl-C is how a recording without --seconds ends, so what was recorded until then is kept.
    with stop_on_signals() as stop:
        try:
            recording, parts, lines = _recorded(options, before, stop)
        except NothingRecorded as nothing:
            typer.echo("\n".join(nothing.lines))
            raise
        archive = MotionArchive(parts, (*(before.recordings if before else ()), recording))
        write_archive(output, archive)
    typer.echo("\n".join(lines))
    seconds_added = len(recording.positions) / recording.rate_hz
    typer.echo(f"{output}: added {seconds_added:.1f} s, now {plural(len(archive.recordings), 'recording')}")


def _recorded(
    options: RecordOptions, before: "MotionArchive | None", stop: threading.Event
) -> "tuple[Recording, tuple[str, ...], Sequence[str]]":
    """A recording for the archive `before`, its body parts, and lines about its quality."""
    import numpy as np

    from common.config import read_scene
    from observer.motion.archive import Recording
    from observer.recording.capture import open_cameras, read_cameras
    from observer.recording.new_recording import build_recording, with_trial

    seconds, observers = options.seconds, split_list("--observers", options.observers)
    with ProgressBar() as bar:
        cameras = open_cameras(read_scene(options.scene), observers, stop, before.body_parts if before else None)
        parts = tuple(cameras[0].tracker.body_parts)
        trial, empty = "" if options.trial is None else str(options.trial), np.zeros((0, 0, 3), np.float32)
        blank = Recording(empty, options.rate, options.label, options.subject, trial)
        blank = with_trial(blank, before, parts, str(options.output))
        until = "until their sources end, or Ctrl-C" if seconds is None else f"for {seconds:g} s"
        names = ", ".join(camera.name for camera in cameras)
        typer.echo(
            f"recording {blank.label or 'other motion'} by {blank.subject}, trial {blank.trial}, with {names}, {until}"
        )
        tracks = read_cameras(cameras, stop, seconds, _progress(bar, seconds))
        recording, lines = build_recording(
            tracks, parts, blank, lambda done, total: bar("triangulating", done, total),
            gate_px=options.gate, up=options.up, front=options.front, trim=options.trim,
        )  # fmt: skip
        return recording, parts, lines


def _progress(bar: ProgressBar, seconds: float | None) -> Callable[[float], None]:
    def show(done_s: float) -> None:
        if seconds is not None:
            bar("recording", round(10 * min(done_s, seconds)), round(10 * seconds))

    return show


def place(
    scene: Annotated[Path, typer.Argument(help="The scene file; its observers with a camera file as view take part.")],
    seconds: Annotated[
        float | None, typer.Option(min=0.1, max=86_400, help="Duration; recorded sources: until they end.")
    ] = 5.0,
    observers: Annotated[str, typer.Option(help="Only these observers, separated by commas.")] = "",
    gate: Gate = None,
) -> None:
    """Find where the person stands and faces in the room of the camera files, and print the lines for the scene file.

    Example: labanmesh camera place scene.toml --seconds 5
    """
    from common.config import read_scene
    from common.lifecycle import log_to_stderr, stop_on_signals
    from observer.recording.capture import open_cameras, read_cameras
    from observer.recording.person_placement import PLACING_HZ, SHOULDERS_AND_HIPS, seen_person

    log_to_stderr()
    with stop_on_signals() as stop, ProgressBar() as bar:
        cameras = open_cameras(read_scene(scene), split_list("--observers", observers), stop, SHOULDERS_AND_HIPS)
        names, parts = ", ".join(camera.name for camera in cameras), tuple(cameras[0].tracker.body_parts)
        typer.echo(f"looking for a person who stands, with {names}; Ctrl-C ends it earlier")
        tracks = read_cameras(cameras, stop, seconds, _progress(bar, seconds))
        person = seen_person(tracks, parts, PLACING_HZ, gate, lambda done, total: bar("triangulating", done, total))
    line = "left and right hand" if person.by_hands else "left and right of the trunk"
    typer.echo(
        f"head in {person.head_seen:.0%} of the time, {line} in {person.sides_seen:.0%}, facing to within "
        f"{person.spread_deg:.0f} degrees; median reprojection error {person.error_px:.1f} px"
    )
    for doubt in person.doubts:
        typer.echo(f"-> {doubt}")
    x, y, z = person.placement.place
    typer.echo(f"[person]\nplace = [{x:.2f}, {y:.2f}, {z:.2f}]\nfacing = {person.placement.facing_deg:.0f}")
