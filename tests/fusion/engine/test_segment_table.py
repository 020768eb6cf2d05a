"""The segmenter's table of transitions is complete, and drawn into the design page."""

import re

import pytest

import fusion.engine.segmenter as rules
from benchmarks.segment_figure import PAGE, with_table
from fusion.engine.segment_conditions import Event
from fusion.engine.segmenter import TABLE, TRANSITIONS, Effect
from fusion.engine.segments import SegmentState

ROWS = [(state, row) for state, rows in TABLE.items() for row in rows]
NUMBERS = {int(number) for number in re.findall(r"(?m)^(\d+)\. ", rules.__doc__)}


def test_each_state_event_and_effect_is_used():
    assert {state for state, _ in ROWS} == set(SegmentState) and {row.event for row in TRANSITIONS} == set(Event)
    assert {row.effect for row in TRANSITIONS} == set(Effect)


@pytest.mark.parametrize(("state", "row"), ROWS)
def test_each_transition_follows_a_rule_and_each_event_has_one_row(state, row):
    assert row.rule in NUMBERS
    assert [other.event for other in TABLE[state]].count(row.event) == 1


def test_the_page_has_the_table_as_it_is():
    page = PAGE.read_text(encoding="utf-8")
    assert page == with_table(page), "run python -m benchmarks.segment_figure"
