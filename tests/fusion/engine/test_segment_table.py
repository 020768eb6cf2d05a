"""The segmenter's table of transitions is complete, and drawn into the design page."""

import re

import pytest

import fusion.engine.segmenter as rules
from benchmarks.segment_figure import PAGE, with_table
from fusion.engine.segment_conditions import GUARDS
from fusion.engine.segment_table import TABLE, Effect, Event, SegmentState
from fusion.engine.segmenter import EFFECTS

ROWS = [(state, row) for state, rows in TABLE.items() for row in rows]
NUMBERS = {int(number) for number in re.findall(r"(?m)^(\d+)\. ", rules.__doc__)}


def test_each_state_event_and_effect_is_used_and_has_its_code():
    assert set(TABLE) == set(SegmentState) and {row.event for _, row in ROWS} == set(Event) == set(GUARDS)
    assert {row.effect for _, row in ROWS} == set(Effect) == set(EFFECTS)


@pytest.mark.parametrize(("state", "row"), ROWS)
def test_each_transition_follows_a_rule_and_each_event_has_one_row(state, row):
    assert row.rule in NUMBERS
    assert [other.event for other in TABLE[state]].count(row.event) == 1


def test_the_page_has_the_table_as_it_is():
    page = PAGE.read_text(encoding="utf-8")
    assert page == with_table(page), "run python -m benchmarks.segment_figure"
