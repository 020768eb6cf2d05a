"""The segmenter's table of transitions is complete, and drawn into the design page."""

import re

import pytest

import fusion.engine.segmenter as rules
from benchmarks.segment_figure import PAGE, with_table
from fusion.engine.segment_conditions import GUARDS
from fusion.engine.segment_table import FOLLOWED, TABLE, Effect, Event, SegmentState
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


def test_each_state_is_reached_from_idle_and_leads_back():
    steps = {state: {row.state for row in rows} for state, rows in TABLE.items()}
    forwards = reached(SegmentState.IDLE, steps)
    assert forwards == set(SegmentState)
    assert all(SegmentState.IDLE in reached(state, steps) for state in SegmentState)


def reached(state, steps):
    found, new = set(), {state}
    while new:
        found |= new
        new = {target for each in new for target in steps[each]} - found
    return found


def test_only_a_decided_movement_is_revised_and_only_what_is_published_leaves_it():
    decided = {
        SegmentState.DECIDED,
        SegmentState.PASSED,
        SegmentState.UNSEEN,
        SegmentState.ENDING,
        SegmentState.SETTLED,
    }
    for state, row in ROWS:
        if row.effect in (Effect.REVISE, Effect.NEXT, Effect.NEXT_NOW):
            assert state in decided
        if state in decided and row.state not in decided:
            assert row.effect.value.startswith("ended")
        if state not in decided and row.state in decided:
            assert row.effect is Effect.DECIDE
    assert set(FOLLOWED.values()) <= {SegmentState.MOVING, SegmentState.PAUSED}


def test_the_page_has_the_table_as_it_is():
    page = PAGE.read_text(encoding="utf-8")
    assert page == with_table(page), "run python -m benchmarks.segment_figure"
