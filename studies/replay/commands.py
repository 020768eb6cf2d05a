"""The verb `labanmesh replay`: judges a capture again, or plays it back onto a mesh."""

import json as json_text
from pathlib import Path
from typing import Annotated

import typer

from common.config import read_scene
from common.errors import BadInput
from common.lifecycle import stop_on_signals
from common.progress import ProgressBar
from common.text import one_of, plural
from studies.replay.comparison import as_json, as_text
from studies.replay.from_judgements import ReplayChange
from studies.replay.judging import judge_again
from studies.replay.playback import PlaybackOptions, play


def replay(
    capture: Annotated[Path, typer.Argument(help="The capture (.mcap), from labanmesh capture.")],
    without: Annotated[
        list[str] | None, typer.Option(metavar="OBSERVER", help="Leave this observer out; may be repeated.")
    ] = None,
    rule: Annotated[str | None, typer.Option(help="Another fusion rule.")] = None,
    quorum: Annotated[
        int | None, typer.Option(min=1, max=1000, help="Another number of observers that must agree.")
    ] = None,
    threshold: Annotated[float | None, typer.Option(min=0, max=1, help="Another least fused probability.")] = None,
    json: Annotated[bool, typer.Option("--json", help="The result as JSON.")] = False,
    onto: Annotated[
        Path | None, typer.Option(metavar="SCENE", help="Play it onto the mesh of this scene file instead of judging.")
    ] = None,
    speed: Annotated[
        float, typer.Option(min=0.01, max=1000, help="With --onto: a factor, e.g. 4 for four times as fast.")
    ] = 1.0,
    only: Annotated[
        str, typer.Option(help="With --onto: all; or posteriors, for a fusion service that runs there.")
    ] = "all",
) -> None:
    """Judge a capture again, unchanged (bit for bit) or with a change, such as without one camera; or play it back.

    Without --onto no mesh is needed. Exit status 1 when verdicts differ although nothing was changed.

    Example: labanmesh replay monday.mcap

    Example: labanmesh replay monday.mcap --without camera2 --rule log

    Example: labanmesh replay monday.mcap --onto scene.toml --only posteriors
    """
    change = ReplayChange(tuple(without or ()), rule, quorum, threshold)
    options = PlaybackOptions(speed, one_of("--only", only, ("all", "posteriors")) == "posteriors")
    if onto is None and options != PlaybackOptions():
        raise BadInput("--speed, --only: only for playing back; add --onto SCENE")
    if onto is None:
        raise typer.Exit(0 if _judge(capture, change, json) else 1)
    if change.any or json:
        raise BadInput("--onto SCENE plays a capture unchanged; omit all options but --speed and --only")
    _play(capture, onto, options)


def _judge(path: Path, change: ReplayChange, json: bool) -> bool:
    """Judge it again and print the result; returns whether it agrees wherever it should."""
    from common.capture_file import CaptureFile

    capture = CaptureFile(path)
    with ProgressBar() as bar:
        result = judge_again(capture, change, bar)
    if json:
        print(json_text.dumps(as_json(result, str(path), capture.complete), indent=1))
    else:
        print(as_text(result, str(path), capture.complete))
    return result.faithful


def _play(path: Path, onto: Path, options: PlaybackOptions) -> None:
    from common.capture_file import CaptureFile

    capture, scene = CaptureFile(path), read_scene(onto)
    with stop_on_signals() as stop, ProgressBar() as bar:
        count = play(capture, scene, options, stop, bar)
    print(f"{path}: {plural(count, 'message')} played onto {scene.mesh.endpoint}")
