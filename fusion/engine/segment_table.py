"""The table of the segmenter: states, events, and the transition of each event in each state. Pure.

The rules are those of segmenter.py; `python -m studies.figures.segments` draws the table into fusion.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum


class State(Enum):
    """What is known of the person."""

    IDLE = "the person rests, or does something else"
    MOVING = "a movement goes on, undecided"
    PAUSED = "undecided, and the person has come to rest"
    LOST = "undecided, and an outage hid how it went on; the person rests"
    DECIDED = "a decided movement goes on"
    PASSED = "decided, and something else, or an outage, was since"
    UNSEEN = "decided, here or by another service, and not seen since"
    ENDING = "decided, and the person has come to rest"
    SETTLED = "decided or revised at rest"


class Event(Enum):
    """What a step shows; the condition of each is in segment_conditions.py, `GUARDS`."""

    MOVES = "a movement is likelier than rest and something else"
    MOVES_AGAIN = "the rest is over"
    RESTS = "the person is at rest"
    NAMED = "a label may be decided"
    RESTED = "rest has lasted for long enough"
    MISSED = "without rest, it has not been seen for long enough"
    SEEN = "its label is the likeliest one, after the decision"
    RETURNS = "its label is likely enough again"
    CONFIRMED = "its label is held again after an outage"
    LEFT = "something else is likelier"
    NEXT = "another label is held, since later than the begin"
    ANOTHER = "another label is held"
    MOVES_ON = "a movement is likelier again, and its label is not"
    PREMATURE = "another label is held, long after the decision"
    RENAMED = "another label, or something else, was held as rest began"
    OUTAGE = "an outage is over"
    OUTAGE_IN_MOTION = "an outage is over, and the person moves"
    OUTAGE_AT_REST = "an outage is over, and the person does not move"
    LONG_OUTAGE_AT_REST = "an outage that may hide a movement is over, and the person does not move"
    LONG_OUTAGE = "an outage that hides more than a movement is over"


class Effect(Enum):
    """What follows; those with a stage publish it."""

    NOTHING = ""
    BEGIN = "begins"
    REST = "rests"
    DROP = "no verdict"
    MISS = "may have ended"
    CONFIRM = "goes on"
    DECIDE = "decided"
    REVISE = "revised"
    END = "ended"
    ABSTAIN = "ended: abstain"
    OUTLAST = "ended: when it was seen last"
    NEXT = "ended; the next begins when its label did"
    NEXT_NOW = "ended; the next begins"


@dataclass(frozen=True, slots=True)
class Row:
    """One transition of the table. rule: its number in segmenter.py."""

    event: Event
    state: State
    effect: Effect
    rule: int


_UNDECIDED = (
    Row(Event.LONG_OUTAGE_AT_REST, State.IDLE, Effect.ABSTAIN, 9),
    Row(Event.OUTAGE_AT_REST, State.LOST, Effect.REST, 9),
    Row(Event.OUTAGE_IN_MOTION, State.MOVING, Effect.BEGIN, 9),
)
_OUTAGE = (
    Row(Event.LONG_OUTAGE, State.IDLE, Effect.OUTLAST, 9),
    Row(Event.OUTAGE, State.PASSED, Effect.MISS, 9),
)
_DECIDED = (*_OUTAGE, Row(Event.RESTS, State.ENDING, Effect.REST, 4))
_ENDING = (
    *_OUTAGE,
    Row(Event.RENAMED, State.SETTLED, Effect.REVISE, 6),
    Row(Event.RESTED, State.IDLE, Effect.END, 4),
)
_RESTING = (
    Row(Event.RESTED, State.IDLE, Effect.END, 5),
    Row(Event.NAMED, State.SETTLED, Effect.DECIDE, 2),
)
TABLE: Mapping[State, tuple[Row, ...]] = {
    State.IDLE: (Row(Event.MOVES, State.MOVING, Effect.BEGIN, 1),),
    State.MOVING: (
        *_UNDECIDED,
        Row(Event.RESTS, State.PAUSED, Effect.REST, 5),
        Row(Event.NAMED, State.UNSEEN, Effect.DECIDE, 2),
        Row(Event.MISSED, State.IDLE, Effect.DROP, 5),
    ),
    State.PAUSED: (*_UNDECIDED, *_RESTING, Row(Event.MOVES_AGAIN, State.MOVING, Effect.NOTHING, 5)),
    State.LOST: (
        *_UNDECIDED,
        *_RESTING,
        Row(Event.MOVES, State.MOVING, Effect.BEGIN, 9),
        Row(Event.LEFT, State.IDLE, Effect.DROP, 9),
    ),
    State.DECIDED: (
        *_DECIDED,
        Row(Event.CONFIRMED, State.DECIDED, Effect.CONFIRM, 9),
        Row(Event.NEXT, State.MOVING, Effect.NEXT, 7),
        Row(Event.PREMATURE, State.DECIDED, Effect.REVISE, 7),
        Row(Event.MISSED, State.IDLE, Effect.END, 7),
        Row(Event.LEFT, State.PASSED, Effect.NOTHING, 7),
    ),
    State.PASSED: (
        *_DECIDED,
        Row(Event.ANOTHER, State.MOVING, Effect.NEXT, 7),
        Row(Event.MOVES_ON, State.MOVING, Effect.NEXT_NOW, 7),
        Row(Event.MISSED, State.IDLE, Effect.END, 7),
        Row(Event.RETURNS, State.DECIDED, Effect.NOTHING, 7),
    ),
    State.UNSEEN: (
        *_DECIDED,
        Row(Event.SEEN, State.DECIDED, Effect.NOTHING, 7),
        Row(Event.PREMATURE, State.DECIDED, Effect.REVISE, 7),
        Row(Event.MISSED, State.IDLE, Effect.END, 7),
    ),
    State.ENDING: (*_ENDING, Row(Event.MOVES_AGAIN, State.DECIDED, Effect.NOTHING, 4)),
    State.SETTLED: (*_ENDING, Row(Event.MOVES_AGAIN, State.UNSEEN, Effect.NOTHING, 4)),
}
"""Of each state the events in the order in which they are looked for; a step takes transitions until none is due, each
event once, or until the person is IDLE."""
FOLLOWED: Mapping[State, State] = {
    State.IDLE: State.MOVING,
    State.DECIDED: State.MOVING,
    State.PASSED: State.MOVING,
    State.UNSEEN: State.MOVING,
    State.ENDING: State.PAUSED,
    State.SETTLED: State.PAUSED,
}
"""The state after another service has published that its movement goes on, undecided; of the others the same."""
