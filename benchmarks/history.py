"""The history: queries on a month of verdicts, and a writer that is killed.

    python -m benchmarks.history [--rows 20000] [--kills 100]

Queries are those of the page (a day, a label, the newest 1,000) and of `labanmesh history`, without the interpreter's
start, in processor time. A row is acknowledged when the writer has printed its number; it is killed with SIGKILL at a
random moment.
"""

import io
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import redirect_stdout
from pathlib import Path
from statistics import median
from typing import Annotated

import typer

from benchmarks.command_line import run_command
from common import SECOND_NS
from hub.history.history_file import HistoryFile, HistoryQuery
from hub.history.records import HistoryRow
from labanmesh import main

BEGIN_NS, DAY_S = 1_790_000_000 * SECOND_NS, 86_400
DETAIL = '{"why": "wave 59 % of the 60 % needed; 13 % something else", "rule": "guarded_product", "fusion": "fusion"}'
ROUNDS = 20
WRITER = """
import sys
from pathlib import Path
from hub.history.history_file import HistoryFile
from hub.history.records import HistoryRow
with HistoryFile.to_write(Path(sys.argv[1])) as file:
    n = file.rows
    while True:
        n += 1
        file.add(HistoryRow("verdict", f"v{n}", "wave", "ended", n, n, n))
        print(n, flush=True)
"""


def filled(path: Path, rows: int) -> None:
    """A file with a month of verdicts."""
    step_ns = 30 * DAY_S * SECOND_NS // rows
    with HistoryFile.to_write(path) as file:
        file.add(
            *(
                HistoryRow("verdict", f"v{n}", f"movement_{n % 20}", "ended", BEGIN_NS + n * step_ns,
                           BEGIN_NS + n * step_ns + SECOND_NS, BEGIN_NS + n * step_ns + SECOND_NS, 0.9, 3, 4,
                           detail=DETAIL)
                for n in range(rows)
            )
        )  # fmt: skip


def queries(path: Path) -> None:
    """Print the median and the longest time of each query."""
    day = HistoryQuery(from_ns=BEGIN_NS + 9 * DAY_S * SECOND_NS, until_ns=BEGIN_NS + 10 * DAY_S * SECOND_NS)
    for name, query in {
        "a day": day,
        "a label": HistoryQuery(label="movement_7"),
        "the newest 1,000": HistoryQuery(),
        "nothing": HistoryQuery(label="unknown"),
    }.items():
        times_s = []
        for _ in range(ROUNDS):
            begun_s = time.process_time()
            with HistoryFile.to_read(path) as file:
                rows = [row.as_page() for row in file.select(query)]
            times_s.append(time.process_time() - begun_s)
        print(f"{name:<18} {1e3 * median(times_s):5.1f} ms, at most {1e3 * max(times_s):5.1f} ms, {len(rows)} rows")
    scene = path.with_name("scene.toml")
    scene.write_text(f'scene = "room"\n[observers.cam1]\nsource = "a.npz"\n[history]\nfile = "{path.name}"\n')
    times_s = []
    for _ in range(ROUNDS):
        begun_s = time.process_time()
        with redirect_stdout(io.StringIO()):
            main(["history", str(scene), "--last", "1000", "--label", "movement_7"])
        times_s.append(time.process_time() - begun_s)
    print(f"{'the command':<18} {1e3 * median(times_s):5.1f} ms, at most {1e3 * max(times_s):5.1f} ms")


def kills(path: Path, number: int) -> None:
    """Print how many acknowledged rows are missing after so many kills."""
    lost = 0
    rng = random.Random(0)  # noqa: S311 - moments, no secrets
    for _ in range(number):
        command = [sys.executable, "-c", WRITER, str(path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as writer:  # noqa: S603 - the command line is ours
            assert writer.stdout is not None  # noqa: S101 - it was opened as a pipe
            first = writer.stdout.readline()
            time.sleep(rng.random() * 0.02)
            os.kill(writer.pid, signal.SIGKILL)
            lines = [first, *writer.stdout.read().splitlines(keepends=True)]
        acknowledged = max(int(line) for line in lines if line.endswith(b"\n"))
        with HistoryFile.to_read(path) as file:
            lost += max(acknowledged - file.rows, 0)
            rows = file.rows
    print(f"{number} kills, {rows} rows, {lost} acknowledged ones lost")


def history(
    rows: Annotated[int, typer.Option(min=100, help="Verdicts in the file.")] = 20_000,
    kill: Annotated[int, typer.Option("--kills", min=0, help="How often the writer is killed.")] = 100,
) -> None:
    """Measure queries of a history, and kill its writer.

    Example: python -m benchmarks.history --kills 10
    """
    with tempfile.TemporaryDirectory() as folder:
        filled(Path(folder) / "history.db", rows)
        queries(Path(folder) / "history.db")
        if kill:
            kills(Path(folder) / "killed.db", kill)


if __name__ == "__main__":
    raise SystemExit(run_command(history, "history"))
