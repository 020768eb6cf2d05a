"""The tables of docs/design/scale.md in markdown, each between its own marks. Pure."""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields

from benchmarks.command_line import markdown_table
from benchmarks.scale.homes import (
    DOWN,
    FULL,
    OUT,
    UP,
    Assumptions,
    Design,
    MembershipChange,
    Scale,
    flows,
    full_process,
    power_cost,
    processes,
    scaled,
    simulate_homes,
    simulate_region,
)
from benchmarks.scale.measured import CrowdRun, Measured
from benchmarks.scale.process import Load, ProcessTrace, Stay, simulate_many, simulate_one

CROWDS = (1, 10, 25, 50, 100, 150, 200, 250, 400)
FACTORS = tuple(10**n for n in range(7))
SECONDS = 3.0
SLOTS = 8
"""Parts of a frame interval in which a share of the crowd publishes (benchmarks/crowd/crowd.py)."""
DIES_S, STARTS_S, PLAYED_S = 1.0, 2.0, 3.0
MONTH_S = 730 * 3600


@dataclass(frozen=True, slots=True)
class ScaleInputs:
    """The input of the tables."""

    measured: Measured
    assumed: Assumptions
    load: Load
    homes: Sequence[int] = FACTORS

    @property
    def full(self) -> int:
        """Homes of a full fusion process."""
        return full_process(self.measured.costs, self.load)


def marks(name: str) -> tuple[str, str]:
    """The lines before and after the table of that name in the page."""
    return f"<!-- scale {name}: from here to the end mark, `make scale` writes -->", "<!-- scale: end -->"


def tables(inputs: ScaleInputs) -> dict[str, str]:
    """All tables by name."""
    return {name: make(inputs) for name, make in TABLES.items()}


def simulate_run(measured: Measured, run: CrowdRun) -> ProcessTrace:
    """A run of the crowd, simulated: with its wake-up delays, its share of the machine, its observers in step."""
    # The crowd polls as often as some of it publish.
    slots_hz = SLOTS * run.rate_hz
    load = Load(run.rate_hz, in_step=True, wake_ms=run.wake_ms, bursts_hz=slots_hz, poll_s=1 / slots_hz, cores=run.left)
    seconds = min(run.seconds, SECONDS)
    if run.scenes == 1:
        return simulate_one(measured.costs, load, seconds)
    return simulate_many(measured.costs, load, [Stay(n) for n in range(run.scenes)], seconds)


def _costs(inputs: ScaleInputs) -> str:
    measured, words = inputs.measured, dict(WORDS)
    rows = [[words[field.name], f"{getattr(measured.costs, field.name):.1f}"] for field in fields(measured.costs)]
    return f"Measured on {measured.date}: {measured.machine}.\n\n{markdown_table(['what', 'µs'], rows)}"


def _checked(inputs: ScaleInputs) -> str:
    head = ["observers", "", "share of a core", "judgements per second", "age, median", "age, 99 %"]
    rows = []
    for run in inputs.measured.runs:
        ages = _ms(run.age_median_ms), _ms(run.age_p99_ms)
        rows.append([f"{run.observers:,}", "measured", f"{run.core_share:.2f}", f"{run.judgements_hz:,.0f}", *ages])
        rows.append(["", "simulated", *_figures(simulate_run(inputs.measured, run))])
    return markdown_table(head, rows)


def _grown(inputs: ScaleInputs) -> str:
    head = ["homes", "posteriors per second", "share of a core", "judgements per second", "age, median", "age, 99 %"]
    rows = []
    for homes in CROWDS:
        trace = simulate_homes(inputs.measured.costs, inputs.load, homes)
        due_hz = homes * inputs.load.step_hz
        posteriors_hz = homes * inputs.load.observers * inputs.load.rate_hz
        rows.append([f"{homes:,}", f"{posteriors_hz:,.0f}", *_figures(trace), f"{trace.judgements_hz / due_hz:.0%}"])
    return markdown_table([*head, "judged in time"], rows)


def _together(inputs: ScaleInputs) -> str:
    costs, full = inputs.measured.costs, inputs.full
    head = ["processes", "homes", "share of a core, busiest", "least", "age, 99 %"]
    head += ["homes moved by a death and a start", "longest without a judgement"]
    rows = []
    for count in (2, 4):
        names = [f"north{n}" for n in range(count)]
        homes = full * (count - 1) // 2
        changes = (MembershipChange(DIES_S, names[-1], False), MembershipChange(STARTS_S, names[-1] + "b", True))
        region = simulate_region(costs, inputs.load, homes, names, PLAYED_S, changes)
        quiet = simulate_region(costs, inputs.load, homes, names, PLAYED_S)
        shares = (f"{share:.2f}" for share in (quiet.core_shares[0], quiet.core_shares[-1]))
        change = f"{region.moved:,}", _ms(region.gap_s.max() * 1e3)
        rows.append([f"{count}", f"{homes:,}", *shares, _ms(quiet.age_ms(99)), *change])
    return markdown_table(head, rows)


def _links(inputs: ScaleInputs) -> str:
    head = ["key", "link", *(f"{design.value}: messages per second" for design in Design)]
    head += [f"bytes per second, {design.value}" for design in Design]
    rates: dict[tuple[str, str], dict[Design, tuple[float, float]]] = {}
    for design in Design:
        for flow in flows(design, inputs.measured.sizes, inputs.assumed, inputs.load):
            rates.setdefault((flow.key, flow.link), {})[design] = (flow.messages_hz, flow.bytes_hz)
    order = (UP, DOWN, OUT)
    rows = [
        [key, link, *(_rounded(by.get(design, (0, 0))[part]) for part in (0, 1) for design in Design)]
        for (key, link), by in sorted(rates.items(), key=lambda item: order.index(item[0][1]))
    ]
    for link in order:
        sums = [sum(by.get(d, (0, 0))[1] for (_, to), by in rates.items() if to == link) for d in Design]
        totals = (f"{_rounded(each)} = {each * MONTH_S / 1e9:.2f} GB a month" for each in sums)
        rows.append(["**all**", link, "", "", *totals])
    return markdown_table(head, rows)


def _factors(inputs: ScaleInputs) -> str:
    head = ["homes", "design", "cells", "fusion processes", "routers", "busy cores", "memory", "messages per second"]
    head += ["Mbit/s in", "machines", "traffic", "storage", "people", "all"]
    full, measured = inputs.full, inputs.measured
    rows = [
        _factor(scaled(homes, design, measured.costs, measured.sizes, inputs.assumed, inputs.load, full))
        for homes in inputs.homes
        for design in Design
    ]
    return markdown_table(head, rows)


def _factor(scale: Scale) -> list[str]:
    return [
        f"{scale.homes:,}" if scale.design is Design.HOME else "",
        scale.design.value,
        f"{scale.cells:,}",
        f"{scale.fusion:,}",
        f"{scale.routers:,}",
        _rounded(scale.cores),
        f"{scale.memory_gb:,.1f} GB",
        _rounded(scale.messages_hz),
        _rounded(scale.bytes_hz * 8 / 1e6),
        *(f"${price:,.2f}" for price in (*astuple(scale.bill), scale.bill.total)),
    ]


def _assumed(inputs: ScaleInputs) -> str:
    assumed = inputs.assumed
    rows = [[f"`{field.name}`", f"{getattr(assumed, field.name):g}"] for field in fields(assumed)]
    full = inputs.full
    in_step = next(run.core_share for run in inputs.measured.runs if run.scenes == 1)
    own = simulate_one(inputs.measured.costs, inputs.load, SECONDS).core_share
    cell = round(assumed.cell)
    text = (
        f"One process judges {full:,} homes, {inputs.load.step_hz:g} times per second each, with {FULL:.0%} of a core "
        f"in its loop; a cell of {cell:,} needs {processes(cell, full)} processes, one of them a spare. In a home "
        f"fusion judges as soon as a posterior arrives: {in_step:.2f} of a core with cameras in step (measured), "
        f"{own:.2f} with cameras at their own times (simulated), whose power costs "
        f"${power_cost(own, assumed):.2f} a month."
    )
    return f"{text}\n\n{markdown_table(['assumption', 'value'], rows)}"


def _tokens(inputs: ScaleInputs) -> str:
    head = ["tokens", "declared in", "all known in", "memory of the subscriber", "of the declarer"]
    rows = [
        [
            f"{t.declared:,}",
            f"{t.declare_s:.2f} s",
            f"{t.known_s:.2f} s",
            f"{t.listener_mb:.0f} MB",
            f"{t.declarer_mb:.0f} MB",
        ]
        for t in inputs.measured.tokens
    ]
    return markdown_table(head, rows)


def _figures(trace: ProcessTrace) -> list[str]:
    ages = [_ms(trace.age_ms(50)), _ms(trace.age_ms(99))]
    return [f"{trace.core_share:.2f}", f"{trace.judgements_hz:,.0f}", *ages]


def _ms(age: float) -> str:
    return f"{age:,.0f} ms" if age >= 10 else f"{age:.1f} ms"


def _rounded(number: float) -> str:
    """With as many digits as are meaningful."""
    if not number:
        return "0"
    return f"{number:,.0f}" if number >= 100 else f"{number:.1f}" if number >= 1 else f"{number:.2g}"


TABLES: dict[str, Callable[[ScaleInputs], str]] = {
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
    ("receive", "a posterior arrives, in Zenoh's threads"),
    ("burst", "in addition, whenever several arrive at once"),
    ("call", "a posterior arrives where a thread hands it to the loop (a process of one scene)"),
    ("take", "the newest posterior of an observer is taken from its ring"),
    ("decode", "it is decoded, checked and added"),
    ("judge", "a judgement of four observers, and everything else of a scene that is due"),
    ("publish", "it is encoded and put"),
    ("cold", "once for all scenes that are judged together"),
    ("status", "a status"),
    ("round", "a scene that is not due, per round"),
    ("turn", "a round without scenes: wait and wake up"),
    ("take_over", "a scene is taken over, with all its declarations"),
    ("forward", "a router forwards a message"),
    ("hop", "from a put to the arrival, on the loopback (elapsed time, not processor time)"),
)
