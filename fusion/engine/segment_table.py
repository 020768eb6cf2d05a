"""The table of the segmenter: states, events, and the transition of each event in each state. Pure.

The rules are those of segmenter.py; `python -m studies.figures.segments` draws the table into fusion.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum


class SegmentState(Enum):
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
    PREMATURE = "another label is held before this one can be over, or long after the decision"
    RENAMED = "another label, or something else, was held as rest began"
    OUTAGE = "an outage is over"
    OUTAGE_IN_MOTION = "an outage is over, and the person moves"
    OUTAGE_AT_REST = "an outage is over, and the person does not move"
    LONG_OUTAGE_AT_REST = "an outage that may hide a movement is over, and the person does not move"
    LONG_OUTAGE = "it was so long that the same label would be another movement"


class Effect(Enum):
    """What follows; those with a stage publish it."""

    NOTHING = ""
    BEGIN = "begins"
    REST = "rests"
    DROP = "no verdict, or ended with a label that was only contested"
    MISS = "may have ended"
    CONFIRM = "goes on"
    DECIDE = "decided"
    REVISE = "revised"
    END = "ended"
    NEXT = "ended; the next begins when its label did"
    NEXT_NOW = "ended; the next begins"


@dataclass(frozen=True, slots=True)
class Transition:
    """One transition of the table. rule: its number in segmenter.py."""

    event: Event
    state: SegmentState
    effect: Effect
    rule: int


_WHILE_UNDECIDED = (
    Transition(Event.LONG_OUTAGE_AT_REST, SegmentState.IDLE, Effect.END, 9),
    Transition(Event.OUTAGE_AT_REST, SegmentState.LOST, Effect.REST, 9),
    Transition(Event.OUTAGE_IN_MOTION, SegmentState.MOVING, Effect.BEGIN, 9),
)
_OUTAGE = Transition(Event.OUTAGE, SegmentState.PASSED, Effect.MISS, 9)
_DECIDED = (_OUTAGE, Transition(Event.RESTS, SegmentState.ENDING, Effect.REST, 4))
_WHILE_ENDING = (
    _OUTAGE,
    Transition(Event.RENAMED, SegmentState.SETTLED, Effect.REVISE, 6),
    Transition(Event.RESTED, SegmentState.IDLE, Effect.END, 4),
)
_WHILE_RESTING = (
    Transition(Event.RESTED, SegmentState.IDLE, Effect.END, 5),
    Transition(Event.NAMED, SegmentState.SETTLED, Effect.DECIDE, 2),
)
TABLE: Mapping[SegmentState, tuple[Transition, ...]] = {
    SegmentState.IDLE: (Transition(Event.MOVES, SegmentState.MOVING, Effect.BEGIN, 1),),
    SegmentState.MOVING: (
        *_WHILE_UNDECIDED,
        Transition(Event.RESTS, SegmentState.PAUSED, Effect.REST, 5),
        Transition(Event.NAMED, SegmentState.UNSEEN, Effect.DECIDE, 2),
        Transition(Event.MISSED, SegmentState.IDLE, Effect.DROP, 5),
    ),
    SegmentState.PAUSED: (
        *_WHILE_UNDECIDED,
        *_WHILE_RESTING,
        Transition(Event.MOVES_AGAIN, SegmentState.MOVING, Effect.NOTHING, 5),
    ),
    SegmentState.LOST: (
        *_WHILE_UNDECIDED,
        *_WHILE_RESTING,
        Transition(Event.MOVES, SegmentState.MOVING, Effect.BEGIN, 9),
        Transition(Event.LEFT, SegmentState.IDLE, Effect.DROP, 9),
    ),
    SegmentState.DECIDED: (
        *_DECIDED,
        Transition(Event.CONFIRMED, SegmentState.DECIDED, Effect.CONFIRM, 9),
        Transition(Event.NEXT, SegmentState.MOVING, Effect.NEXT, 7),
        Transition(Event.PREMATURE, SegmentState.DECIDED, Effect.REVISE, 7),
        Transition(Event.MISSED, SegmentState.IDLE, Effect.END, 7),
        Transition(Event.LEFT, SegmentState.PASSED, Effect.NOTHING, 7),
    ),
    SegmentState.PASSED: (
        _OUTAGE,
        Transition(Event.LONG_OUTAGE, SegmentState.IDLE, Effect.END, 9),
        _DECIDED[1],
        Transition(Event.ANOTHER, SegmentState.MOVING, Effect.NEXT, 7),
        Transition(Event.MOVES_ON, SegmentState.MOVING, Effect.NEXT_NOW, 7),
        Transition(Event.MISSED, SegmentState.IDLE, Effect.END, 7),
        Transition(Event.RETURNS, SegmentState.DECIDED, Effect.NOTHING, 7),
    ),
    SegmentState.UNSEEN: (
        *_DECIDED,
        Transition(Event.SEEN, SegmentState.DECIDED, Effect.NOTHING, 7),
        Transition(Event.PREMATURE, SegmentState.DECIDED, Effect.REVISE, 7),
        Transition(Event.MISSED, SegmentState.IDLE, Effect.END, 7),
    ),
    SegmentState.ENDING: (*_WHILE_ENDING, Transition(Event.MOVES_AGAIN, SegmentState.DECIDED, Effect.NOTHING, 4)),
    SegmentState.SETTLED: (*_WHILE_ENDING, Transition(Event.MOVES_AGAIN, SegmentState.UNSEEN, Effect.NOTHING, 4)),
}
"""Of each state the events in the order in which they are looked for; a step takes transitions until none is due, each
event once, or until the person is IDLE."""
FOLLOWED: Mapping[SegmentState, SegmentState] = {
    SegmentState.IDLE: SegmentState.MOVING,
    SegmentState.DECIDED: SegmentState.MOVING,
    SegmentState.PASSED: SegmentState.MOVING,
    SegmentState.UNSEEN: SegmentState.MOVING,
    SegmentState.ENDING: SegmentState.PAUSED,
    SegmentState.SETTLED: SegmentState.PAUSED,
}
"""The state after another service has published that its movement goes on, undecided; of the others the same."""
