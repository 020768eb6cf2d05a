"""Times and counts of the runs, and their figures as a markdown table with one column per transport. Pure."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median, quantiles

from benchmarks.command_line import markdown_table
from benchmarks.transports.actors import ReceivedJudgement
from benchmarks.transports.kinds import KINDS

RunFigures = dict[str, float]
"""The figures of one run by name."""
BEGIN = "<!-- transports: from here to the end mark, `make peers-transport` writes -->"
END = "<!-- transports: end -->"


@dataclass(frozen=True, slots=True)
class FigureRange:
    """The median over the rounds, and the lowest and highest of them."""

    median: float
    low: float
    high: float


def latencies(put_ns: Mapping[str, Sequence[int]], judgements: Iterable[ReceivedJudgement]) -> list[int]:
    """Nanoseconds from each put to the first judgement with it or a later message of the same publisher.

    put_ns: by publisher, from sequence number 1 on. Messages that are in no judgement are left out.
    """
    answered = dict.fromkeys(put_ns, 0)
    times = []
    for received in judgements:
        for name, seq in received.newest.items():
            if name in answered and seq > answered[name]:
                times += [received.arrived_ns - at for at in put_ns[name][answered[name] : seq]]
                answered[name] = seq
    return times


def in_ms(times_ns: Sequence[int]) -> tuple[float, float]:
    """Median and 99th percentile."""
    return median(times_ns) / 1e6, quantiles(times_ns, n=100, method="inclusive")[98] / 1e6


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
