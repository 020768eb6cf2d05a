"""The command `record`: several calibrated cameras add one recording to a motion archive."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.command_options import takes_options
from common.errors import BadInput
from common.progress import ProgressBar
from common.text import plural, split_list

if TYPE_CHECKING:
    from observer.motion.archive import Recording


@dataclass(frozen=True, slots=True)
class RecordOptions:
    """As typed on the command line."""

    scene: Annotated[
        Path, typer.Argument(help="The scene file; its observers with a camera file as view are recorded.")
    ]
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The motion archive (.npz); an existing one is extended.")
    ]
    subject: Annotated[str, typer.Option(help="The performer.")]
    label: Annotated[str, typer.Option(help="The movement: lower case letters, digits, underscores.")] = ""
    other_motion: Annotated[
        bool,
        typer.Option("--other-motion", help="In place of --label: anything but the movements, for learn --background."),
    ] = False
    trial: Annotated[int | None, typer.Option(min=0, help="Number of the trial; by default the next free one.")] = None
    seconds: Annotated[
        float | None, typer.Option(min=0.1, help="Duration; by default until the sources end or Ctrl-C.")
    ] = None
    observers: Annotated[str, typer.Option(help="Only these observers, separated by commas.")] = ""
    rate: Annotated[float, typer.Option(min=1, max=1000, help="Rate of the recording, Hz.")] = 30.0
    gate: Annotated[float, typer.Option(min=0.1, help="Largest reprojection error of a camera that counts, px.")] = 20.0
    up: Annotated[str, typer.Option(help="The axis of the calibration that points up: x, -x, y, -y, z or -z.")] = "y"
    front: Annotated[str, typer.Option(help="The axis along which the performer faces.")] = "-z"
    trim: Annotated[bool, typer.Option("--trim", help="Cut off the rest before and after the movement.")] = False


@takes_options
def record(options: RecordOptions) -> None:
    """Record one movement with several calibrated cameras, and add its positions in space to a motion archive.

    Example: labanmesh record scene.toml -o mine.npz --label wave --subject anna --seconds 5

    Example: labanmesh record scene.toml -o life.npz --other-motion --subject anna --seconds 300
    """
    from common.lifecycle import log_to_stderr, stop_on_signals
    from observer.motion.archive_file import read_archive, write_archive
    from observer.recording.reconstruction import performer_axes
    from observer.recording.recorded import appended, with_trial
    from observer.tracks import BODY_PARTS

    log_to_stderr()
    performer_axes(options.up, options.front)
    if bool(options.label) == options.other_motion:
        raise BadInput("--label: name the movement, or give --other-motion for motion that is none; one of them")
    output = options.output
    before = read_archive(output) if output.exists() else None
    name = with_trial(_unrecorded(options), before, BODY_PARTS, str(output))
    # Ctrl-C is how a recording without --seconds ends, so what was recorded until then is kept.
    with stop_on_signals() as stop:
        recording, lines = _recorded(options, name, stop)
        archive = appended(before, BODY_PARTS, recording)
        write_archive(output, archive)
    typer.echo("\n".join(lines))
    seconds_added = len(recording.positions) / recording.rate_hz
    typer.echo(f"{output}: added {seconds_added:.1f} s, now {plural(len(archive.recordings), 'recording')}")


def _unrecorded(options: RecordOptions) -> "Recording":
    """The recording without its frames."""
    import numpy as np

    from observer.motion.archive import Recording
    from observer.tracks import BODY_PARTS

    trial = "" if options.trial is None else str(options.trial)
    empty = np.zeros((0, len(BODY_PARTS), 3), np.float32)
    return Recording(empty, options.rate, options.label, options.subject, trial)


def _recorded(options: RecordOptions, name: "Recording", stop: threading.Event) -> "tuple[Recording, Sequence[str]]":
    """The recording with its frames, and how it went, in lines."""
    from common.config import read_scene
    from observer.recording.capture import open_cameras, read_cameras
    from observer.recording.recorded import RecordingOptions, build_recording
    from observer.tracks import BODY_PARTS

    seconds = options.seconds
    with ProgressBar() as bar:
        cameras = open_cameras(read_scene(options.scene), split_list("--observers", options.observers), stop)
        until = "until their sources end, or Ctrl-C" if seconds is None else f"for {seconds:g} s"
        names = ", ".join(camera.name for camera in cameras)
        typer.echo(
            f"recording {name.label or 'other motion'} by {name.subject}, trial {name.trial}, with {names}, {until}"
        )
        tracks = read_cameras(cameras, stop, seconds, lambda done: _show_progress(bar, done, seconds))
        axes_and_gate = RecordingOptions(options.gate, options.up, options.front, options.trim)
        return build_recording(
            tracks, BODY_PARTS, name, axes_and_gate, lambda done, total: bar("triangulating", done, total)
        )


def _show_progress(bar: ProgressBar, done_s: float, seconds: float | None) -> None:
    if seconds is not None:
        bar("recording", round(10 * min(done_s, seconds)), round(10 * seconds))
