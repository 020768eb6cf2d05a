"""The command `record`: several calibrated cameras add one recording to a motion archive."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.errors import BadInput
from common.progress import ProgressBar
from common.text import plural

if TYPE_CHECKING:
    from observer.motion.archive import Recording
    from observer.recording.recorded import RecordingOptions


def record(
    scene: Annotated[
        Path, typer.Argument(help="The scene file; its observers with a camera file as view are recorded.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The motion archive (.npz); an existing one is extended.")
    ],
    subject: Annotated[str, typer.Option(help="The performer.")],
    label: Annotated[str, typer.Option(help="The movement: lower case letters, digits, underscores.")] = "",
    other_motion: Annotated[
        bool,
        typer.Option("--other-motion", help="In place of --label: anything but the movements, for learn --background."),
    ] = False,
    trial: Annotated[int | None, typer.Option(min=0, help="Number of the trial; by default the next free one.")] = None,
    seconds: Annotated[
        float | None, typer.Option(min=0.1, help="Duration; by default until the sources end or Ctrl-C.")
    ] = None,
    observers: Annotated[str, typer.Option(help="Only these observers, separated by commas.")] = "",
    rate: Annotated[float, typer.Option(min=1, max=1000, help="Rate of the recording, Hz.")] = 30.0,
    gate: Annotated[
        float, typer.Option(min=0.1, help="Largest reprojection error of a camera that counts, px.")
    ] = 20.0,
    up: Annotated[str, typer.Option(help="The axis of the calibration that points up: x, -x, y, -y, z or -z.")] = "y",
    front: Annotated[str, typer.Option(help="The axis along which the performer faces.")] = "-z",
    trim: Annotated[bool, typer.Option("--trim", help="Cut off the rest before and after the movement.")] = False,
) -> None:
    """Record one movement with several calibrated cameras, and add its positions in space to a motion archive.

    Example: labanmesh record scene.toml -o mine.npz --label wave --subject anna --seconds 5

    Example: labanmesh record scene.toml -o life.npz --other-motion --subject anna --seconds 300
    """
    import numpy as np

    from common.lifecycle import log_to_stderr
    from common.text import split_list
    from observer.motion.archive import Recording
    from observer.recording.reconstruction import performer_axes
    from observer.recording.recorded import RecordingOptions
    from observer.tracks import BODY_PARTS

    log_to_stderr()
    performer_axes(up, front)
    if bool(label) == other_motion:
        raise BadInput("--label: name the movement, or give --other-motion for motion that is none; one of them")
    empty = np.zeros((0, len(BODY_PARTS), 3), np.float32)
    name = Recording(empty, rate, label, subject, "" if trial is None else str(trial))
    _record(scene, split_list("--observers", observers), output, name, seconds, RecordingOptions(gate, up, front, trim))


def _record(
    scene: Path,
    observers: Sequence[str],
    output: Path,
    name: "Recording",
    seconds: float | None,
    options: "RecordingOptions",
) -> None:
    from common.config import read_scene
    from common.lifecycle import stop_on_signals
    from observer.motion.archive_file import read_archive, write_archive
    from observer.recording.capture import open_cameras, read_cameras
    from observer.recording.recorded import appended, build_recording, with_trial
    from observer.tracks import BODY_PARTS

    before = read_archive(output) if output.exists() else None
    name = with_trial(name, before, BODY_PARTS, str(output))
    # Ctrl-C is how a recording without --seconds ends, so what was recorded until then is kept.
    with stop_on_signals() as stop, ProgressBar() as bar:
        cameras = open_cameras(read_scene(scene), observers, stop)
        until = "until their sources end, or Ctrl-C" if seconds is None else f"for {seconds:g} s"
        names = ", ".join(camera.name for camera in cameras)
        typer.echo(
            f"recording {name.label or 'other motion'} by {name.subject}, trial {name.trial}, with {names}, {until}"
        )
        tracks = read_cameras(cameras, stop, seconds, lambda done: _show_progress(bar, done, seconds))
        recording, lines = build_recording(
            tracks, BODY_PARTS, name, options, lambda done, total: bar("triangulating", done, total)
        )
        archive = appended(before, BODY_PARTS, recording)
        write_archive(output, archive)
    typer.echo("\n".join(lines))
    seconds_added = len(recording.positions) / recording.rate_hz
    typer.echo(f"{output}: added {seconds_added:.1f} s, now {plural(len(archive.recordings), 'recording')}")


def _show_progress(bar: ProgressBar, done_s: float, seconds: float | None) -> None:
    if seconds is not None:
        bar("recording", round(10 * min(done_s, seconds)), round(10 * seconds))
