"""The tables of docs/design/scale.md in markdown, each between its own marks: what was measured, what follows. Pure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields

from benchmarks.scale.homes import (
    DOWN,
    FULL,
    OUT,
    UP,
    Assumed,
    Change,
    Design,
    Scale,
    drawn,
    flows,
    full_process,
    play,
    processes,
    scaled,
    trial,
)
from benchmarks.scale.measured import Measured, Run
from benchmarks.scale.process import Load, Stay, Trace, alone, shared

CROWDS = (1, 10, 25, 50, 100, 150, 200, 250, 400)
FACTORS = tuple(10**n for n in range(7))
SECONDS = 3.0
SLOTS = 8
"""So many times in a frame interval some of the crowd speak (benchmarks/crowd/crowd.py)."""
DIES_S, COMES_S, PLAYED_S = 1.0, 2.0, 3.0
MONTH_S = 730 * 3600


@dataclass(frozen=True, slots=True)
class Question:
    """What the tables are made for."""

    measured: Measured
    assumed: Assumed
    load: Load
    homes: Sequence[int] = FACTORS


def marks(name: str) -> tuple[str, str]:
    """Between which the table of that name stands in the page."""
    return f"<!-- scale {name}: from here to the end mark, `make scale` writes -->", "<!-- scale: end -->"


def tables(question: Question) -> dict[str, str]:
    """All, by name."""
    return {name: make(question) for name, make in TABLES.items()}


def rewritten(page: str, made: Mapping[str, str]) -> str:
    """The page with each table between its marks instead of what stood there; raises KeyError with a missing mark."""
    for name, table in made.items():
        begin, end = marks(name)
        before, found, rest = page.partition(begin)
        _, ended, after = rest.partition(end)
        if not (found and ended):
            raise KeyError(begin)
        page = f"{before}{begin}\n{table}\n{end}{after}"
    return page


def replayed(measured: Measured, run: Run) -> Trace:
    """A run of the crowd, simulated: as late woken, with as much of the machine, its observers in step."""
    # The crowd looks what has come as often as some of it speak.
    slots_hz = SLOTS * run.rate_hz
    load = Load(run.rate_hz, in_step=True, wake_ms=run.wake_ms, bursts_hz=slots_hz, ear_s=1 / slots_hz, cores=run.left)
    seconds = min(run.seconds, SECONDS)
    if run.scenes == 1:
        return alone(measured.costs, load, seconds)
    return shared(measured.costs, load, [Stay(n) for n in range(run.scenes)], seconds)


def _costs(question: Question) -> str:
    measured, what = question.measured, dict(WORDS)
    rows = [[what[field.name], f"{getattr(measured.costs, field.name):.1f}"] for field in fields(measured.costs)]
    said = f"Measured on {measured.date}: {measured.machine}."
    return f"{said}\n\n{_table(['what', 'µs'], rows)}"


def _checked(question: Question) -> str:
    head = ["observers", "", "of a core", "judgements a second", "age, median", "age, 99 %"]
    rows = []
    for run in question.measured.runs:
        trace = replayed(question.measured, run)
        ages = _ms(run.age_median_ms), _ms(run.age_p99_ms)
        rows.append([f"{run.observers:,}", "measured", f"{run.core_share:.2f}", f"{run.judgements_hz:,.0f}", *ages])
        rows.append(["", "simulated", *_of(trace)])
    return _table(head, rows)


def _grown(question: Question) -> str:
    head = ["homes", "posteriors a second", "of a core", "judgements a second", "age, median", "age, 99 %", "judged"]
    rows = []
    for homes in CROWDS:
        trace = trial(question.measured.costs, question.load, homes)
        wanted_hz = homes * question.load.step_hz
        come_hz = homes * question.load.observers * question.load.rate_hz
        rows.append([f"{homes:,}", f"{come_hz:,.0f}", *_of(trace), f"{trace.judgements_hz / wanted_hz:.0%}"])
    return _table(head, rows)


def _together(question: Question) -> str:
    costs, full = question.measured.costs, _full(question)
    head = ["processes", "homes", "of a core, busiest", "least", "age, 99 %"]
    head += ["homes moved by a death and a coming", "longest without a judgement"]
    rows = []
    for count in (2, 4):
        names = [f"north{n}" for n in range(count)]
        homes = full * (count - 1) // 2
        changes = (Change(DIES_S, names[-1], False), Change(COMES_S, names[-1] + "b", True))
        region = play(costs, question.load, homes, names, PLAYED_S, changes)
        quiet = play(costs, question.load, homes, names, PLAYED_S)
        shares = (f"{share:.2f}" for share in (quiet.core_shares[0], quiet.core_shares[-1]))
        change = f"{region.moved:,}", _ms(region.gap_s.max() * 1e3)
        rows.append([f"{count}", f"{homes:,}", *shares, _ms(quiet.age_ms(99)), *change])
    return _table(head, rows)


def _links(question: Question) -> str:
    head = ["key", "link", *(f"{design.value}: messages a second" for design in Design)]
    head += [f"bytes a second, {design.value}" for design in Design]
    found: dict[tuple[str, str], dict[Design, tuple[float, float]]] = {}
    for design in Design:
        for flow in flows(design, question.measured.sizes, question.assumed, question.load):
            found.setdefault((flow.key, flow.link), {})[design] = (flow.messages_hz, flow.bytes_hz)
    order = (UP, DOWN, OUT)
    rows = [
        [key, link, *(_least(by.get(design, (0, 0))[part]) for part in (0, 1) for design in Design)]
        for (key, link), by in sorted(found.items(), key=lambda item: order.index(item[0][1]))
    ]
    for link in order:
        sums = [sum(by.get(d, (0, 0))[1] for (_, to), by in found.items() if to == link) for d in Design]
        rows.append(
            ["**all**", link, "", "", *(f"{_least(each)} = {each * MONTH_S / 1e9:.2f} GB a month" for each in sums)]
        )
    return _table(head, rows)


def _factors(question: Question) -> str:
    head = ["homes", "design", "cells", "fusion processes", "routers", "busy cores", "memory", "messages in a second"]
    head += ["Mbit/s in", "machines", "traffic", "storage", "people", "all"]
    full = _full(question)
    rows = [_factor(_scale(question, homes, design, full)) for homes in question.homes for design in Design]
    return _table(head, rows)


def _factor(scale: Scale) -> list[str]:
    bill = scale.bill
    return [
        f"{scale.homes:,}" if scale.design is Design.HOME else "",
        scale.design.value,
        f"{scale.cells:,}",
        f"{scale.fusion:,}",
        f"{scale.routers:,}",
        _least(scale.cores),
        f"{scale.memory_gb:,.1f} GB",
        _least(scale.messages_hz),
        _least(scale.bytes_hz * 8 / 1e6),
        *(f"${price:,.2f}" for price in (bill.machines, bill.traffic, bill.storage, bill.people, bill.total)),
    ]


def _assumed(question: Question) -> str:
    said = question.assumed
    rows = [[f"`{field.name}`", f"{getattr(said, field.name):g}"] for field in fields(said)]
    full = _full(question)
    in_step = next(run.core_share for run in question.measured.runs if run.scenes == 1)
    own = alone(question.measured.costs, question.load, SECONDS).core_share
    cell = round(said.cell)
    told = (
        f"One process judges {full:,} homes, {question.load.step_hz:g} times a second each, with {FULL:.0%} of a core "
        f"in its loop; a cell of {cell:,} takes {processes(cell, full)}, one of them to spare. In a home of its own "
        f"fusion judges as soon as something has come: {in_step:.2f} of a core where the cameras are in step "
        f"(measured), {own:.2f} where each speaks at its own time (simulated), which draws "
        f"${drawn(own, said):.2f} a month."
    )
    return f"{told}\n\n{_table(['assumed', 'taken'], rows)}"


def _tokens(question: Question) -> str:
    head = ["tokens", "declared in", "all known in", "memory of who asked", "of who declared"]
    return _table(
        head,
        [
            [
                f"{t.declared:,}",
                f"{t.declare_s:.2f} s",
                f"{t.known_s:.2f} s",
                f"{t.listener_mb:.0f} MB",
                f"{t.declarer_mb:.0f} MB",
            ]
            for t in question.measured.tokens
        ],
    )


def _full(question: Question) -> int:
    return full_process(question.measured.costs, question.load)


def _scale(question: Question, homes: int, design: Design, full: int) -> Scale:
    measured = question.measured
    return scaled(homes, design, measured.costs, measured.sizes, question.assumed, question.load, full)


def _of(trace: Trace) -> list[str]:
    ages = [_ms(trace.age_ms(50)), _ms(trace.age_ms(99))]
    return [f"{trace.core_share:.2f}", f"{trace.judgements_hz:,.0f}", *ages]


def _ms(age: float) -> str:
    return f"{age:,.0f} ms" if age >= 10 else f"{age:.1f} ms"


def _least(number: float) -> str:
    """With as many digits as say something."""
    return (
        "0"
        if not number
        else f"{number:,.0f}"
        if number >= 100
        else f"{number:.1f}"
        if number >= 1
        else f"{number:.2g}"
    )


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


TABLES: dict[str, Callable[[Question], str]] = {
    "costs": _costs,
    "checked": _checked,
    "grown": _grown,
    "together": _together,
    "links": _links,
    "assumed": _assumed,
    "factors": _factors,
    "tokens": _tokens,
}
WORDS = (
    ("receive", "a posterior comes, in Zenoh's threads"),
    ("burst", "more of that each time that some come at once"),
    ("call", "a posterior comes, where a thread brings it to the loop (a process of one scene)"),
    ("take", "the newest of an observer is taken"),
    ("hear", "it is decoded, checked and heard"),
    ("judge", "a judgement of four observers, and what else belongs to a scene that is due"),
    ("say", "it is encoded and put"),
    ("cold", "what all that are judged together share"),
    ("tell", "a status"),
    ("round", "a scene that is not due, each round"),
    ("turn", "a round by itself: to wait, and to come back"),
    ("sit", "a scene is taken over: all that it declares"),
    ("forward", "a router passes a message on"),
    ("hop", "from a put until it has arrived, on the loopback (time, not processor's)"),
)
