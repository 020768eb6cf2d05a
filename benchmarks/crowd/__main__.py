"""`python -m benchmarks.crowd`: a thousand SIMULATED observers and real fusion processes, with progress."""

import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.command_line import run_command
from benchmarks.crowd.trial import CrowdPlan, run_trial


def crowd(
    scenes: Annotated[int, typer.Option(min=1, help="Scenes, with four observers each.")] = 250,
    rate: Annotated[float, typer.Option(min=0.1, help="Posteriors per second of each observer.")] = 30.0,
    minutes: Annotated[float, typer.Option(min=0.01, help="Duration after the warm-up.")] = 10.0,
    processes: Annotated[int, typer.Option(min=1, max=15, help="Fusion processes that share the scenes.")] = 1,
    kill: Annotated[bool, typer.Option("--kill", help="Kill one process halfway and start another later.")] = False,
) -> int:
    """Run the crowd and print its result; exit status 1 when a verdict was lost or published twice.

    Example: python -m benchmarks.crowd --scenes 125 --minutes 0.4 --processes 2
    """
    plan = CrowdPlan(scenes, rate, minutes * 60, processes, kill)
    with tempfile.TemporaryDirectory() as folder:
        result = run_trial(plan, Path(folder), lambda line: print(line, file=sys.stderr, flush=True))
    print(result.table())
    return 0 if result.whole else 1


if __name__ == "__main__":
    sys.exit(run_command(crowd, "crowd"))
