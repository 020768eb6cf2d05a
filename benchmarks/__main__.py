"""`python -m benchmarks`: measures everything, prints a table and writes build/bench.json. Takes about five minutes.

LABANMESH_DATA names the folder of recordings; without it the models are learned from the synthetic performer.
"""

import json
import os
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path

from benchmarks import fusion, mesh, observer, observer_steps, recovery, security
from benchmarks.command_line import run_command
from benchmarks.crowd import trial
from benchmarks.timing import BenchmarkRow
from studies.report import make_folder, write_text

RESULT = Path("build/bench.json")
HEAD = ("", "ours", "floor", "ratio", "over the floor", "n")


def bench() -> None:
    """Measure all rows; print them as a table, and write them as JSON to build/bench.json."""
    place = os.environ.get("LABANMESH_DATA")
    data = Path(place) if place else None
    groups = (
        ("tracking", observer_steps.tracking_rows()),
        ("model updates", observer_steps.model_rows(data)),
        ("observer", observer.rows(data)),
        ("fusion step", fusion.step_rows()),
        ("mesh", mesh.rows()),
        ("posteriors per second", fusion.flood_rows()),
        ("crowd", trial.rows()),
        ("recovery", recovery.rows()),
        ("security", security.rows()),
    )
    make_folder(RESULT.parent, "a change of directory")
    rows = list(
        chain.from_iterable(with_progress(name, n, len(groups), own) for n, (name, own) in enumerate(groups, 1))
    )
    write_text(RESULT, as_json(rows), "a change of directory")
    print(table(rows))
    print(f"\nMedians of alternating rounds, except rows with p99; written to {RESULT}")


def with_progress(group: str, number: int, groups: int, rows: Iterable[BenchmarkRow]) -> list[BenchmarkRow]:
    """The rows of a group; its begin and each row are reported on stderr."""
    begun_s = time.monotonic()
    print(f"[{number}/{groups}] {group} ...", file=sys.stderr, flush=True)
    done: list[BenchmarkRow] = []
    for row in rows:
        print(f"  {time.monotonic() - begun_s:4.0f} s  {row.name}", file=sys.stderr, flush=True)
        done.append(row)
    return done


def as_json(rows: Sequence[BenchmarkRow]) -> str:
    """The rows as JSON, one per line."""
    return "[\n" + ",\n".join(json.dumps(asdict(row)) for row in rows) + "\n]\n"


def table(rows: Sequence[BenchmarkRow]) -> str:
    """The rows for people; `over the floor` is ours - floor."""
    cells = [HEAD, *(_cells(row) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [_line(row, widths) for row in cells]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])


def _cells(row: BenchmarkRow) -> tuple[str, ...]:
    digits = {"ms": 3, "s": 2}.get(row.unit, 1)
    times = (f"{value:.{digits}f} {row.unit}" for value in (row.ours, row.floor))
    return (row.name, *times, f"{row.ratio:.2f}", f"{row.ours - row.floor:+.{digits}f} {row.unit}", str(row.n))


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    numbers = (f"{cell:>{width}}" for cell, width in zip(cells[1:], widths[1:], strict=True))
    return "  ".join([f"{cells[0]:<{widths[0]}}", *numbers])


if __name__ == "__main__":
    sys.exit(run_command(bench, "bench"))
