"""The verb `labanmesh replay`: a capture judged anew, or played back onto a mesh."""

import json as json_text
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast, get_args

import typer

from common.errors import BadInput
from common.progress import ProgressBar
from common.text import one_of

if TYPE_CHECKING:
    from common.capture_file import CaptureFile
    from studies.replay.from_judgements import Change
    from studies.replay.playback import Manner


def replay(
    capture: Annotated[Path, typer.Argument(help="The capture (.mcap), from labanmesh capture.")],
    without: Annotated[
        list[str] | None, typer.Option(metavar="OBSERVER", help="Leave this observer out; may be repeated.")
    ] = None,
    rule: Annotated[str | None, typer.Option(help="Pool by this fusion rule instead.")] = None,
    quorum: Annotated[int | None, typer.Option(min=1, help="So many observers must agree instead.")] = None,
    threshold: Annotated[float | None, typer.Option(min=0, max=1, help="Least pooled probability instead.")] = None,
    source: Annotated[
        str | None, typer.Option("--from", help="judgements (else, where there are none: posteriors).")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="The result as JSON.")] = False,
    onto: Annotated[
        Path | None, typer.Option(metavar="SCENE", help="Play it onto the mesh of this scene file instead of judging.")
    ] = None,
    speed: Annotated[float, typer.Option(min=0, help="With --onto: so much faster; 0 is as fast as possible.")] = 1.0,
    only: Annotated[str, typer.Option(help="With --onto: posteriors, for a referee that runs there.")] = "all",
    as_recorded: Annotated[
        bool, typer.Option("--as-recorded", help="With --onto: the very bytes, with the times of then.")
    ] = False,
) -> None:
    """Judge a capture anew: the same verdicts, bit for bit? Would they stand without camera 2? Or play it back.

    Without --onto no mesh is needed. Status 1 when verdicts differ though nothing was changed.

    Example: labanmesh replay monday.mcap

    Example: labanmesh replay monday.mcap --without camera2 --rule log

    Example: labanmesh replay monday.mcap --onto scene.toml --only posteriors
    """
    from common.capture_file import CaptureFile
    from studies.replay.from_judgements import Change
    from studies.replay.playback import Manner

    change = Change(tuple(without or ()), rule, quorum, threshold)
    posteriors_only = one_of("--only", only, ("all", "posteriors")) == "posteriors"
    if onto is None:
        if (speed, posteriors_only, as_recorded) != (1.0, False, False):
            raise BadInput("--speed, --only, --as-recorded: how to play a capture; name a mesh too, with --onto SCENE")
        raise typer.Exit(0 if _judge(CaptureFile(capture), change, source, json) else 1)
    if change.any or json or source:
        raise BadInput("--onto SCENE plays a capture as it is; --without, --rule, --from and the like only judge it")
    _play(CaptureFile(capture), onto, Manner(speed, posteriors_only, as_recorded))


def _judge(capture: "CaptureFile", change: "Change", source: str | None, json: bool) -> bool:
    """Judge it anew and tell the result; returns whether it is what it should be."""
    from studies.replay.comparison import Source, as_json, as_text
    from studies.replay.judging import judge_anew

    if source is not None:
        one_of("--from", source, get_args(Source))
    with ProgressBar() as bar:
        found = judge_anew(capture, change, cast("Source | None", source), bar)
    name = str(capture.path)
    if json:
        print(json_text.dumps(as_json(found, name, capture.complete), indent=1))
    else:
        print(as_text(found, name, capture.complete))
    return found.faithful


def _play(capture: "CaptureFile", onto: Path, manner: "Manner") -> None:
    from common.config import read_scene
    from common.lifecycle import stop_on_signals
    from studies.replay.playback import play

    scene = read_scene(onto)
    with stop_on_signals() as stop, ProgressBar() as bar:
        said = play(capture, scene, manner, stop, bar)
    print(f"{capture.path}: {said} messages played onto {scene.mesh.endpoint}")
