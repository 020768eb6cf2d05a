"""The verb `labanmesh replay`: judges a capture again."""

import json as json_text
from pathlib import Path
from typing import Annotated

import typer

from common.progress import ProgressBar


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
) -> None:
    """Judge a capture again, unchanged (bit for bit) or with a change, such as without one camera.

    No mesh is needed. Exit status 1 when verdicts differ although nothing was changed.

    Example: labanmesh replay monday.mcap

    Example: labanmesh replay monday.mcap --without camera2 --rule log
    """
    from common.capture_file import CaptureFile
    from studies.replay.comparison import as_json, as_text
    from studies.replay.from_judgements import ReplayChange
    from studies.replay.judging import judge_again

    file = CaptureFile(capture)
    with ProgressBar() as bar:
        result = judge_again(file, ReplayChange(tuple(without or ()), rule, quorum, threshold), bar)
    if json:
        print(json_text.dumps(as_json(result, str(capture), file.complete), indent=1))
    else:
        print(as_text(result, str(capture), file.complete))
    raise typer.Exit(0 if result.faithful else 1)
