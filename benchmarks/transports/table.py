"""Times and counts of the runs, and their figures as a markdown table with one column a transport. Pure."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median, quantiles

from benchmarks.transports.kinds import KINDS

Judgements = Sequence[tuple[int, Mapping[str, int]]]
Found = dict[str, float]
"""One run's figures by name."""


@dataclass(frozen=True, slots=True)
class Figure:
    """The median over the rounds, the lowest and the highest of them."""

    median: float
    low: float
    high: float


def latencies(put_ns: Mapping[str, Sequence[int]], judgements: Judgements) -> list[int]:
    """Nanoseconds from each put to the first judgement that names it or a later one of the same publisher.

    put_ns: by publisher, that of sequence number 1 first. What no judgement names is left out.
    """
    answered = dict.fromkeys(put_ns, 0)
    times = []
    for arrived_ns, newest in judgements:
        for name, seq in newest.items():
            if name in answered and seq > answered[name]:
                times += [arrived_ns - at for at in put_ns[name][answered[name] : seq]]
                answered[name] = seq
    return times


def in_ms(times_ns: Sequence[int]) -> tuple[float, float]:
    """Median and 99th percentile."""
    return median(times_ns) / 1e6, quantiles(times_ns, n=100, method="inclusive")[98] / 1e6


def over_rounds(rounds: Iterable[Found]) -> dict[str, Figure]:
    """Each figure over all rounds that have it."""
    values: dict[str, list[float]] = {}
    for found in rounds:
        for name, value in found.items():
            values.setdefault(name, []).append(value)
    return {name: Figure(median(some), min(some), max(some)) for name, some in values.items()}


BEGIN = "<!-- transports: from here to the end mark, `make peers-transport` writes -->"
END = "<!-- transports: end -->"


@dataclass(frozen=True, slots=True)
class Run:
    """So many publishers, each at 60 Hz (paced) or as fast as it can, one referee, so many listeners."""

    name: str
    publishers: int
    listeners: int
    paced: bool = True


RUNS = (Run("4to1", 4, 1), Run("4to4", 4, 4), Run("16to1", 16, 1), Run("flood", 16, 1, paced=False))


@dataclass(frozen=True, slots=True)
class Row:
    """One figure of one run in words. form: how a number is written; ranged: whether the rounds' range stands by it."""

    key: str
    words: str
    form: str = ".2f"
    ranged: bool = True


ROWS = (
    Row("4to1/median_ms", "4 publishers at 60 Hz, 1 listener: median, ms"),
    Row("4to1/p99_ms", "p99, ms"),
    Row("4to4/median_ms", "4 publishers at 60 Hz, 4 listeners: median, ms"),
    Row("4to4/p99_ms", "p99, ms"),
    Row("16to1/median_ms", "16 publishers at 60 Hz, 1 listener: median, ms"),
    Row("16to1/p99_ms", "p99, ms"),
    Row("16to1/arrived", "of these, arrived", ".1%", ranged=False),
    Row("flood/whole_hz", "16 publishers: the most that arrives whole, messages a second", ",.0f"),
    Row("flood/taken_hz", "16 as fast as they can: taken, messages a second", ",.0f"),
    Row("flood/put_hz", "put, messages a second", ",.0f", ranged=False),
    Row("flood/arrived", "of these, arrived", ".1%", ranged=False),
    Row("flood/receiver_us", "CPU of the referee for each it takes, µs", ".1f"),
    Row("flood/broker_us", "CPU of the broker for each, µs", ".1f"),
    Row("flood/publisher_us", "CPU of a publisher for each put, µs", ".1f"),
    Row("4to1/sent_bytes", "bytes that a publisher sends for a posterior", ".0f", ranged=False),
    Row("4to1/start_ms", "a publisher's process start to the judgement of its first posterior, ms", ".0f"),
    Row("4to1/link_ms", "of that, from loading the library on, ms", ".0f"),
)


def as_markdown(figures: Mapping[str, Mapping[str, Figure]], facts: str, left_out: Sequence[str]) -> str:
    """What was measured, what each promises, who is missing, and the table; a figure that nobody has is no row."""
    names = list(figures)
    rows = [row for row in ROWS if any(row.key in figures[name] for name in names)]
    lines = [
        _line(["", *(KINDS[name].name for name in names)]),
        _line(["---", *["---:"] * len(names)]),
        *(_line([row.words, *(_cell(row, figures[name].get(row.key)) for name in names)]) for row in rows),
    ]
    promises = [f"- {KINDS[name].name}: {KINDS[name].quality}" for name in names]
    return "\n".join([facts, "", *promises, *(f"- {line}" for line in left_out), "", *lines])


def _cell(row: Row, figure: Figure | None) -> str:
    if figure is None:
        return ""
    spread = f" ({figure.low:{row.form}} to {figure.high:{row.form}})" if row.ranged else ""
    return f"{figure.median:{row.form}}{spread}"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def rewritten(page: str, table: str) -> str | None:
    """The page with the table between its two marks instead of what stood there; None when it lacks the marks."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    return f"{before}{begin}\n{table}\n{end}{after}" if begin and end else None
