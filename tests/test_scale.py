"""The cost of growth: the simulation agrees with the measurements, the page with the command."""

from dataclasses import fields, replace
from pathlib import Path

import pytest

from benchmarks.scale import __main__ as commands
from benchmarks.scale import process, table
from benchmarks.scale.homes import (
    OUT,
    UP,
    Assumptions,
    Design,
    flows,
    scaled,
)
from benchmarks.scale.measured import Costs, parse_measured
from benchmarks.scale.process import Load
from fusion import server

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/design/scale.md"
TEXT = (ROOT / "benchmarks/scale/measured.json").read_text("utf-8")
MEASURED = parse_measured(TEXT)
FREE = Costs(**{field.name: 0.0 for field in fields(Costs)})
SHARE, AGE = 0.25, 2.0
"""A simulated share of a core, or count of judgements, is off by so much at most, relative; an age by such a factor."""


def dearer(costs, times):
    return Costs(**{field.name: getattr(costs, field.name) * times for field in fields(Costs)})


def off(measured, run):
    """How far the simulation of a run is from it.

    Share of a core and judgements, the larger of the two, relative; the 99 % age as a factor, at least 1.
    """
    trace = table.simulate_run(measured, run)
    age = trace.age_ms(99) / run.age_p99_ms
    share, judged = trace.core_share / run.core_share, trace.judgements_hz / run.judgements_hz
    return max(abs(share - 1), abs(judged - 1)), max(age, 1 / age)


@pytest.mark.parametrize("run", MEASURED.runs, ids=lambda run: f"{run.observers}")
def test_the_simulation_agrees_with_the_measurements(run):
    share, age = off(MEASURED, run)
    assert share <= SHARE and age <= AGE
    for times in (0.5, 2.0):
        assert off(replace(MEASURED, costs=dearer(MEASURED.costs, times)), run)[0] > SHARE


def test_the_simulated_loop_is_set_as_the_real_one():
    real = server.BATCH_PAUSE_S, server.BATCH, server.STATUS_EVERY_S
    assert real == (process.PAUSE_S, process.TOGETHER, process.STATUS_S)


def test_no_posterior_leaves_a_home_that_judges_itself():
    home, region = (
        {(flow.key, flow.link) for flow in flows(design, MEASURED.sizes, Assumptions(), Load())} for design in Design
    )
    assert "posterior" not in {key for key, _ in home}
    assert ("posterior", UP) in region and ("verdict", OUT) in home & region


def test_a_bill_is_what_its_parts_come_to():
    assumed = Assumptions(movements=864, watched=0, overhead=0, cell=10, core_hour=0.1, egress_gb=1.0, support_min=12)
    sizes = replace(MEASURED.sizes, verdict=1000)
    scale = scaled(20, Design.HOME, FREE, sizes, assumed, Load(), 10)
    assert (scale.cells, scale.fusion, scale.routers) == (2, 0, 4)
    assert scale.bill.machines == pytest.approx(4 * 0.1 * 730 / 20)
    # 864 movements a day, two verdicts each: one in 50 s, a thousand bytes.
    assert scale.bill.traffic == pytest.approx(20 * 730 * 3600 / 1e9)
    assert scale.bill.people == pytest.approx(50 * 0.2 / 12)
    assert scale.messages_hz == pytest.approx(20 * (1 + 0.02))
    one = scaled(1, Design.HOME, MEASURED.costs, MEASURED.sizes, Assumptions(), Load(), 100)
    assert (one.fusion, one.routers, one.messages_hz, one.bill.traffic) == (0, 0, 0, 0)


def test_the_page_is_what_the_command_writes(tmp_path):
    page = tmp_path / "scale.md"
    page.write_text(PAGE.read_text("utf-8"), "utf-8")
    commands.scale(page=page)
    assert page.read_text("utf-8") == PAGE.read_text("utf-8"), "make scale writes it anew"
