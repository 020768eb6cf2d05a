"""The command line of the comparison: rounds over all transports by turns, to a table and a file of figures."""

import json as json_text
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from typing import Annotated

import typer

from benchmarks.command_line import markdown_table, read_page, replace_table
from benchmarks.comparisons.transports.clients import KINDS, available, program
from benchmarks.comparisons.transports.stage import RunFigures, flooded, judgement, paced, posteriors, processors
from common.progress import ProgressBar
from common.text import one_of, plural, split_list
from studies.output_files import make_folder, write_text

PACKAGES = {"zenoh": "eclipse-zenoh", "paho": "paho-mqtt", "nats": "nats-py", "zmq": "pyzmq"}
BEGIN = "<!-- transports: from here to the end mark, `make peers-transport` writes -->"
END = "<!-- transports: end -->"


@dataclass(frozen=True, slots=True)
class FigureRange:
    """The median over the rounds, and the lowest and highest of them."""

    median: float
    low: float
    high: float


def over_rounds(rounds: Iterable[RunFigures]) -> dict[str, FigureRange]:
    """Each figure over all rounds that have it."""
    values: dict[str, list[float]] = {}
    for figures in rounds:
        for name, value in figures.items():
            values.setdefault(name, []).append(value)
    return {name: FigureRange(median(some), min(some), max(some)) for name, some in values.items()}


@dataclass(frozen=True, slots=True)
class TransportRun:
    """Publishers, each at 60 Hz (paced) or as fast as possible, one fusion process, listeners."""

    name: str
    publishers: int
    listeners: int
    paced: bool = True


RUNS = (
    TransportRun("4to1", 4, 1),
    TransportRun("4to4", 4, 4),
    TransportRun("16to1", 16, 1),
    TransportRun("flood", 16, 1, paced=False),
)


@dataclass(frozen=True, slots=True)
class FigureRow:
    """One figure of one run. form: the number's format; ranged: whether the range over the rounds is shown."""

    key: str
    words: str
    form: str = ".2f"
    ranged: bool = True


ROWS = (
    FigureRow("4to1/median_ms", "4 publishers at 60 Hz, 1 listener: median, ms"),
    FigureRow("4to1/p99_ms", "p99, ms"),
    FigureRow("4to4/median_ms", "4 publishers at 60 Hz, 4 listeners: median, ms"),
    FigureRow("4to4/p99_ms", "p99, ms"),
    FigureRow("16to1/median_ms", "16 publishers at 60 Hz, 1 listener: median, ms"),
    FigureRow("16to1/p99_ms", "p99, ms"),
    FigureRow("16to1/arrived", "of these, arrived", ".1%", ranged=False),
    FigureRow("flood/whole_hz", "16 publishers: the most that arrives whole, messages a second", ",.0f"),
    FigureRow("flood/taken_hz", "16 as fast as they can: taken, messages a second", ",.0f"),
    FigureRow("flood/put_hz", "put, messages a second", ",.0f", ranged=False),
    FigureRow("flood/arrived", "of these, arrived", ".1%", ranged=False),
    FigureRow("flood/receiver_us", "CPU of the fusion process for each it takes, µs", ".1f"),
    FigureRow("flood/broker_us", "CPU of the broker for each, µs", ".1f"),
    FigureRow("flood/publisher_us", "CPU of a publisher for each put, µs", ".1f"),
    FigureRow("4to1/sent_bytes", "bytes that a publisher sends for a posterior", ".0f", ranged=False),
    FigureRow("4to1/start_ms", "a publisher's process start to the judgement of its first posterior, ms", ".0f"),
    FigureRow("4to1/link_ms", "of that, from loading the library on, ms", ".0f"),
)


def as_markdown(figures: Mapping[str, Mapping[str, FigureRange]], facts: str, left_out: Sequence[str]) -> str:
    """The facts, what each transport guarantees, which are left out, and the table without empty rows."""
    names = list(figures)
    rows = [row for row in ROWS if any(row.key in figures[name] for name in names)]
    cells = [[row.words, *(_cell(row, figures[name].get(row.key)) for name in names)] for row in rows]
    guarantees = [f"- {KINDS[name].name}: {KINDS[name].quality}" for name in names]
    table = markdown_table(["", *(KINDS[name].name for name in names)], cells)
    return "\n".join([facts, "", *guarantees, *(f"- {line}" for line in left_out), "", table])


def _cell(row: FigureRow, figure: FigureRange | None) -> str:
    if figure is None:
        return ""
    spread = f" ({figure.low:{row.form}} to {figure.high:{row.form}})" if row.ranged else ""
    return f"{figure.median:{row.form}}{spread}"


def transports(
    only: Annotated[str, typer.Option(help="The transports, separated by commas.")] = ",".join(KINDS),
    rounds: Annotated[int, typer.Option(min=1, help="Five rounds take about fifteen minutes.")] = 5,
    frames: Annotated[int, typer.Option(min=1, help="Posteriors of each publisher in a run at 60 Hz.")] = 180,
    seconds: Annotated[float, typer.Option(help="Duration of a run as fast as possible.")] = 2.0,
    json: Annotated[Path, typer.Option(help="File for the figures.")] = Path("build/transports.json"),
    page: Annotated[Path | None, typer.Option(help="A markdown page whose table is replaced.")] = None,
) -> None:
    """Compare the transports with the same traffic.

    Example: python -m benchmarks.comparisons.transports --only ours,zenoh --rounds 1
    """
    text = read_page(page, BEGIN, END)
    kinds = available([one_of("--only", name, list(KINDS)) for name in split_list("--only", only)])
    for line in kinds.left_out:
        print(line, file=sys.stderr)
    figures = measure(kinds.names, rounds, frames, seconds)
    table = as_markdown(figures, _facts(kinds.names, rounds), kinds.left_out)
    make_folder(json.parent, "--json")
    write_text(json, json_text.dumps(_as_json(figures, rounds), indent=1) + "\n", "--json")
    if page:
        write_text(page, replace_table(text, table, BEGIN, END), "--page")
    print(table)


def measure(names: Sequence[str], rounds: int, frames: int, seconds: float) -> dict[str, dict[str, FigureRange]]:
    """By transport and figure; in each round the transports take turns, and so does which goes first."""
    figures: dict[str, list[RunFigures]] = {name: [] for name in names}
    total = rounds * len(names)
    with ProgressBar() as bar:
        for number in range(total):
            name = names[(number + number // len(names)) % len(names)]
            figures[name] += _once(name, frames, seconds)
            bar("transports", number + 1, total)
    return {name: over_rounds(some) for name, some in figures.items()}


def _once(name: str, frames: int, seconds: float) -> Iterator[RunFigures]:
    """Each run of the table once, with its name before its figures."""
    for run in RUNS:
        if run.paced:
            figures = paced(name, run.publishers, run.listeners, frames)
        else:
            figures = flooded(name, run.publishers, seconds)
        yield {f"{run.name}/{figure}": value for figure, value in figures.items()}


def _facts(names: Sequence[str], rounds: int) -> str:
    """Machine, sizes and versions in one paragraph."""
    sizes = ", ".join(f"{len(judgement(count)):,} bytes with {count}" for count in sorted({r.publishers for r in RUNS}))
    libraries = [PACKAGES[library] for library in dict.fromkeys(KINDS[name].library for name in names)]
    brokers = [KINDS[name].broker for name in names if KINDS[name].broker]
    versions = [*(f"{name} {_version(name)}" for name in libraries), *(f"{n} {_broker_version(n)}" for n in brokers)]
    return (
        f"{plural(processors(), 'processor')}; {plural(rounds, 'round')}; a posterior of "
        f"{len(posteriors('cam1', 0)[0])} bytes; a judgement of {sizes} publishers. {', '.join(versions)}."
    )


def _version(package: str) -> str:
    with suppress(PackageNotFoundError):
        return version(package)
    return "unknown"


def _broker_version(name: str) -> str:
    option = "-h" if name == "mosquitto" else "--version"
    result = subprocess.run([program(name) or name, option], capture_output=True, text=True, check=False)  # noqa: S603
    match = re.search(r"\d+\.\d+\.\d+", result.stdout)
    return match[0] if match else "unknown"


def _as_json(figures: dict[str, dict[str, FigureRange]], rounds: int) -> dict[str, object]:
    values = {name: {key: asdict(figure) for key, figure in some.items()} for name, some in figures.items()}
    return {"version": 1, "rounds": rounds, "processors": processors(), "transports": values}
