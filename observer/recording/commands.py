"""The verb `record`: several calibrated cameras see somebody, and a motion archive has one recording more."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.progress import ProgressBar

if TYPE_CHECKING:
    from observer.motion.archive import Recording
    from observer.recording.recorded import RecordingOptions


def record(
    scene: Annotated[Path, typer.Argument(help="The scene file; its observers with a camera file as view take part.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The motion archive (.npz); one that is there grows.")],
    label: Annotated[str, typer.Option(help="The movement: lower case letters, digits, underscores.")],
    subject: Annotated[str, typer.Option(help="Who performs it.")],
    trial: Annotated[int | None, typer.Option(min=0, help="Which time; the next one that is free.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0.1, help="How long; else until sources end or Ctrl-C.")] = None,
    observers: Annotated[str, typer.Option(help="Only these of the scene, by commas.")] = "",
    rate: Annotated[float, typer.Option(min=1, max=1000, help="Instants a second.")] = 30.0,
    gate: Annotated[float, typer.Option(min=0.1, help="A camera further off than so many px is outvoted.")] = 20.0,
    up: Annotated[str, typer.Option(help="The axis of the calibration that points up: x, -x, y, -y, z or -z.")] = "y",
    front: Annotated[str, typer.Option(help="The axis along which the performer faces.")] = "-z",
    trim: Annotated[bool, typer.Option("--trim", help="Cut off what is before and after the hands move.")] = False,
) -> None:
    """Several calibrated cameras watch one movement; its positions in space are added to a motion archive.

    Example: labanmesh record scene.toml -o mine.npz --label wave --subject anna --seconds 5
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
    empty = np.zeros((0, len(BODY_PARTS), 3), np.float32)
    name = Recording(empty, rate, label, subject, "" if trial is None else str(trial))
    _record(scene, split_list("--observers", observers), output, name, seconds, RecordingOptions(gate, up, front, trim))


def _record(
    scene: Path,
    observers: Sequence[str],
    output: Path,
    name: "Recording",
    seconds: float | None,
    choices: "RecordingOptions",
) -> None:
    from common.config import read_scene
    from common.lifecycle import stop_on_signals
    from observer.motion.archive_file import read_archive, write_archive
    from observer.recording.capture import open_watchers, watch
    from observer.recording.recorded import appended, completed, recorded
    from observer.tracks import BODY_PARTS

    before = read_archive(output) if output.exists() else None
    named = completed(name, before, BODY_PARTS, str(output))
    # What was seen until Ctrl-C is kept: it is how a recording without --seconds ends.
    with stop_on_signals() as stop, ProgressBar() as bar:
        watchers = open_watchers(read_scene(scene), observers, stop)
        until = "until their sources end, or Ctrl-C" if seconds is None else f"for {seconds:g} s"
        who = ", ".join(one.name for one in watchers)
        typer.echo(f"{who} watch {named.label} by {named.subject}, trial {named.trial}, {until}")
        sighted = watch(watchers, stop, seconds, lambda done: _tell(bar, done, seconds))
        made, lines = recorded(sighted, BODY_PARTS, named, choices, lambda done, all_: bar("placing", done, all_))
        whole = appended(before, BODY_PARTS, made)
        write_archive(output, whole)
    typer.echo("\n".join(lines))
    typer.echo(f"{output}: {len(made.positions) / made.rate_hz:.1f} s more, {len(whole.recordings)} recordings in all")


def _tell(bar: ProgressBar, done_s: float, seconds: float | None) -> None:
    if seconds is not None:
        bar("watching", round(10 * min(done_s, seconds)), round(10 * seconds))
