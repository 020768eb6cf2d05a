"""`python -m benchmarks`: measures everything, prints a table and writes build/bench.json. Takes some minutes.

LABANMESH_DATA names the folder of recordings; without it the models are learned from the synthetic performer.
"""

import json
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path

from benchmarks import fusion, mesh, observer, observer_steps, recovery, security
from benchmarks.crowd import trial
from benchmarks.timing import Row
from common.errors import LabanmeshError

RESULT = Path("build/bench.json")
HEAD = ("", "ours", "floor", "ratio", "over the floor", "n")


def main() -> int:
    """All rows, to stdout and to RESULT; returns the exit status."""
    place = os.environ.get("LABANMESH_DATA")
    try:
        data = Path(place) if place else None
        one = chain(observer_steps.tracking_rows(), observer_steps.model_rows(data), observer.rows(data))
        rows = told(
            chain(
                one,
                fusion.step_rows(),
                mesh.rows(),
                fusion.flood_rows(),
                trial.rows(),
                recovery.rows(),
                security.rows(),
            )
        )
    except LabanmeshError as error:
        print(f"benchmarks: {error}", file=sys.stderr)
        return error.exit_status
    RESULT.parent.mkdir(parents=True, exist_ok=True)
    RESULT.write_text(as_json(rows))
    print(table(rows))
    print(f"\nMedians of alternating rounds, but for the rows that say p99; written to {RESULT}")
    return 0


def told(rows: Iterable[Row]) -> list[Row]:
    """All rows, each told on stderr when it is there."""
    done: list[Row] = []
    for row in rows:
        print(f"measured: {row.name}", file=sys.stderr, flush=True)
        done.append(row)
    return done


def as_json(rows: Sequence[Row]) -> str:
    """The rows as JSON, one a line."""
    return "[\n" + ",\n".join(json.dumps(asdict(row)) for row in rows) + "\n]\n"


def table(rows: Sequence[Row]) -> str:
    """The rows for people; `over the floor` is ours - floor."""
    cells = [HEAD, *(_cells(row) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [_line(row, widths) for row in cells]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])


def _cells(row: Row) -> tuple[str, ...]:
    times = (f"{value:.{_digits(row.unit)}f} {row.unit}" for value in (row.ours, row.floor))
    over = f"{row.ours - row.floor:+.{_digits(row.unit)}f} {row.unit}"
    return (row.name, *times, f"{row.ratio:.2f}", over, str(row.n))


def _digits(unit: str) -> int:
    return {"ms": 3, "s": 2}.get(unit, 1)


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    numbers = (f"{cell:>{width}}" for cell, width in zip(cells[1:], widths[1:], strict=True))
    return "  ".join([f"{cells[0]:<{widths[0]}}", *numbers])


if __name__ == "__main__":
    sys.exit(main())
