"""Why a movement in progress has no verdict yet, as one line for people. Pure."""

from collections.abc import Sequence
from functools import cache
from math import floor

from common.config_sections import FusionConfig
from common.messages import WHY_LIMIT
from fusion.engine.segments import PooledState

NO_OBSERVERS = "waiting for observers"
CONTESTED_REST = "two observers contradict each other on whether the person rests"
ROUND_OFF = 1e-9
NAMES_LIMIT = 3
"""Awaited observers that are listed by name."""


def explain_undecided(
    state: PooledState, observers: int, held_s: float | None, moved_s: float, config: FusionConfig
) -> str | None:
    """What the likeliest label lacks for a verdict; None if it lacks nothing. At most WHY_LIMIT characters.

    observers: how many have a vote that counts. held_s: seconds for which the label has met threshold and quorum
    without a break; None while it does not. moved_s: seconds since the movement began.

    Examples: "wave 59 % of the 60 % needed; 13 % something else", "2 of 3 observers needed vote for wave",
    "wave for 0.1 of 0.2 s".
    """
    if observers == 0:
        return NO_OBSERVERS
    lacks, is_likely = [], state.p >= config.threshold
    if not is_likely:
        lacks.append(f"{state.label} {_percent(state.p)} of the {_demand(config.threshold)} needed")
    if state.agreeing < config.quorum:
        lacks.append(_votes(state.label if is_likely else "it", state.agreeing, observers, config.quorum))
    if not lacks:
        lacks.append(_duration(state.label, held_s or 0.0, moved_s, config.hold_s))
    elif not is_likely and state.unlearned >= 0.01:
        lacks.insert(0 if state.unlearned > state.p else len(lacks), f"{_percent(state.unlearned)} something else")
    return "; ".join(lacks)[:WHY_LIMIT] or None


@cache
def _demand(threshold: float) -> str:
    """Written once: it takes as long as the rest of the sentence."""
    return f"{100 * threshold:g} %"


def why_contested(why: str | None, rests: bool) -> str:
    """The same while two observers contradict each other about rest, and nothing tells which of them is wrong.

    rests: the person rested when they last agreed, so that no label is wanted.
    """
    return CONTESTED_REST if why is None or rests else f"{CONTESTED_REST}; {why}"[:WHY_LIMIT]


def why_waiting(missing: Sequence[str]) -> str:
    """Which observers of the roster have not begun."""
    more = len(missing) - NAMES_LIMIT
    return f"waiting for {', '.join(missing[:NAMES_LIMIT])}{f' and {more} more' if more > 0 else ''} to begin"


def _votes(label: str, agreeing: int, observers: int, quorum: int) -> str:
    if observers < quorum:
        return f"{observers} of {quorum} observers needed {'is' if observers == 1 else 'are'} counted"
    if agreeing == 0:
        return f"no observer votes for {label}, {quorum} needed"
    vote = "votes" if agreeing == 1 else "vote"
    return f"{agreeing} of {quorum} observers needed {vote} for {label}"


def _duration(label: str, held_s: float, moved_s: float, hold_s: float) -> str:
    """The label has not held for long enough, or the whole movement has not lasted for long enough; "" if both have."""
    if held_s < hold_s:
        return f"{label} for {_seconds(held_s)} of {hold_s:g} s"
    return f"moving for {_seconds(moved_s)} of {hold_s:g} s" if moved_s < hold_s else ""


def _percent(p: float) -> str:
    """Rounded down: what is below a threshold must not look as if it had reached it."""
    return f"{floor(100 * p + ROUND_OFF)} %"


def _seconds(seconds: float) -> str:
    return f"{floor(10 * seconds + ROUND_OFF) / 10:.1f}"
