"""`python -m benchmarks`: measures everything, prints tables and writes build/bench.json, within five minutes.

LABANMESH_DATA names the folder of recordings; without it the models are learned from the synthetic performer.
"""

import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from benchmarks import observer, observer_steps, pace, recovery, security
from benchmarks.command_line import run_command
from benchmarks.crowd.trial import CrowdPlan, run_trial
from benchmarks.flood import RATES_HZ, SCENES
from benchmarks.timing import BenchmarkRow, LeftOut
from labanmesh import end_process
from studies.output_files import make_folder, write_text

RESULT = Path("build/bench.json")
TIME_LIMIT_S = 280.0
"""What is not measured by then is left out."""
Rows = Callable[[], Iterable[BenchmarkRow]]
Results = Sequence[BenchmarkRow | LeftOut]
PACE: dict[str, Rows] = {
    "fusion step": pace.step_rows,
    "latency": pace.latency_rows,
    "flood of posteriors": pace.flood_rows,
    "two fusion processes": pace.sharing_rows,
    "start": pace.start_rows,
    "size of a judgement": pace.size_rows,
}


def bench(
    flood_minutes: Annotated[
        float, typer.Option(min=0, help="Instead of all this: the flood of posteriors for so many minutes.")
    ] = 0.0,
    only_pace: Annotated[bool, typer.Option("--pace", help="Only the rows that have a goal, in two minutes.")] = False,
) -> None:
    """Measure all rows; print them as tables, and write them as JSON to build/bench.json.

    Takes less than five minutes. A part that cannot be measured on this machine is left out, with the reason.

    Example: python -m benchmarks --flood-minutes 10
    """
    if flood_minutes:
        long_flood(flood_minutes)
        return
    groups = dict(PACE)
    if not only_pace:
        groups |= other_groups()
    make_folder(RESULT.parent, "a change of directory")
    results = measured(groups, TIME_LIMIT_S)
    write_text(RESULT, as_json(results), "a change of directory")
    print(table(results))
    print(f"\nMedians of alternating rounds, except rows with p99; written to {RESULT}")


def other_groups() -> dict[str, Rows]:
    """The rows without a goal."""
    place = os.environ.get("LABANMESH_DATA")
    data = Path(place) if place else None
    return {
        "tracking": observer_steps.tracking_rows,
        "observer": lambda: observer.rows(data),
        "recovery": recovery.rows,
        "security": security.rows,
    }


def long_flood(minutes: float) -> None:
    """The flood as a soak test, at the highest rate of the short form; prints its result."""
    plan = CrowdPlan(SCENES, RATES_HZ[-1], minutes * 60)
    with tempfile.TemporaryDirectory() as folder:
        print(run_trial(plan, Path(folder), lambda line: print(line, file=sys.stderr, flush=True)).table())


def measured(groups: dict[str, Rows], limit_s: float) -> list[BenchmarkRow | LeftOut]:
    """The rows of all groups; one that fails, or has no time left, is a LeftOut. Progress goes to stderr."""
    end_s = time.monotonic() + limit_s
    results: list[BenchmarkRow | LeftOut] = []
    for number, (name, rows) in enumerate(groups.items(), 1):
        begun_s = time.monotonic()
        print(f"[{number}/{len(groups)}] {name} ...", file=sys.stderr, flush=True)
        try:
            with _time_left(end_s - begun_s):
                for row in rows():
                    print(f"  {time.monotonic() - begun_s:4.0f} s  {row.name}", file=sys.stderr, flush=True)
                    results.append(row)
        except Exception as error:  # noqa: BLE001 - whatever it is, the other parts are measured
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            print(f"  left out: {reason}", file=sys.stderr, flush=True)
            results.append(LeftOut(name, reason))
    return results


@contextmanager
def _time_left(seconds: float) -> Iterator[None]:
    """Raises TimeoutError in the body when the time is over."""

    def end(*_: object) -> None:
        raise TimeoutError("no time was left for it; measure it on a machine with less other work")

    if seconds <= 0:
        end()
    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def as_json(results: Results) -> str:
    """The rows as JSON, one per line; `goal` and `at_least` only where there is a goal."""
    return "[\n" + ",\n".join(json.dumps(_as_dict(result)) for result in results) + "\n]\n"


def _as_dict(result: BenchmarkRow | LeftOut) -> dict[str, object]:
    if isinstance(result, LeftOut):
        return {"name": result.name, "left_out": result.reason}
    fields = asdict(result)
    if result.goal is None:
        del fields["goal"], fields["at_least"]
    return fields


def table(results: Results) -> str:
    """The results for people: rows with a goal, the others, and what was left out."""
    rows = [result for result in results if isinstance(result, BenchmarkRow)]
    with_goal = [_goal_cells(row) for row in rows if row.goal is not None]
    others = [_cells(row) for row in rows if row.goal is None]
    parts = [
        _aligned([("pace", "ours", "goal", "", "floor", "n"), *with_goal]),
        _aligned([("", "ours", "floor", "ratio", "over the floor", "n"), *others]),
        "\n".join(f"left out: {one.name}: {one.reason}" for one in results if isinstance(one, LeftOut)),
    ]
    return "\n\n".join(filter(None, parts))


def _goal_cells(row: BenchmarkRow) -> tuple[str, ...]:
    word = "at least" if row.at_least else "at most"
    verdict = "reached" if row.holds else "missed"
    return (row.name, _figure(row.ours, row.unit), f"{word} {_figure(row.goal or 0.0, row.unit)}", verdict,
            _figure(row.floor, row.unit), str(row.n))  # fmt: skip


def _cells(row: BenchmarkRow) -> tuple[str, ...]:
    over = _figure(row.ours - row.floor, row.unit)
    return (row.name, _figure(row.ours, row.unit), _figure(row.floor, row.unit), f"{row.ratio:.2f}",
            over if over.startswith("-") else f"+{over}", str(row.n))  # fmt: skip


def _figure(value: float, unit: str) -> str:
    digits = {"ms": 3, "s": 2, "core": 2, "times": 2, "/s": 0, "bytes": 0}.get(unit, 1)
    return f"{value:,.{digits}f} {unit}"


def _aligned(cells: Sequence[Sequence[str]]) -> str:
    if len(cells) == 1:
        return ""
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [_line(row, widths) for row in cells]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    numbers = (f"{cell:>{width}}" for cell, width in zip(cells[1:], widths[1:], strict=True))
    return "  ".join([f"{cells[0]:<{widths[0]}}", *numbers])


if __name__ == "__main__":
    # Without the interpreter's own end, as `labanmesh` does after Zenoh.
    end_process(run_command(bench, "bench"))
