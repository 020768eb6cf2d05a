"""Why a movement in progress has no verdict yet, as one line for people. Pure."""

from collections.abc import Iterator
from math import floor

from common.config_sections import FusionConfig
from common.messages import WHY_LIMIT
from fusion.engine.verdict_detector import PooledState

NO_OBSERVERS = "waiting for observers"
ROUND_OFF = 1e-9


def explain_undecided(
    state: PooledState, observers: int, held_s: float | None, moved_s: float, config: FusionConfig
) -> str | None:
    """What the likeliest label lacks for a verdict; None if it lacks nothing. At most WHY_LIMIT characters.

    observers: how many have a vote that counts. held_s: seconds for which the label has met threshold and quorum
    without a break; None while it does not. moved_s: seconds since the movement began.

    Examples: "wave 79 % of the 80 % needed; 13 % something else", "2 of 3 observers needed vote for wave",
    "wave for 0.1 of 0.2 s".
    """
    if observers == 0:
        return NO_OBSERVERS
    lacks = "; ".join(_probability(state, config.threshold))
    if state.agreeing < config.quorum:
        votes = _votes(state, observers, config.quorum)
        lacks = f"{lacks}; {votes}" if lacks else votes
    if not lacks:
        lacks = _duration(state.label, held_s or 0.0, moved_s, config.hold_s)
    return lacks[:WHY_LIMIT] or None


def _probability(state: PooledState, threshold: float) -> Iterator[str]:
    """The label below the threshold, and something else; the likelier first."""
    if state.p >= threshold:
        return
    label = f"{state.label} {_percent(state.p)} of the {100 * threshold:g} % needed"
    other = f"{_percent(state.unlearned)} something else"
    if state.unlearned > state.p:
        yield other
    yield label
    if 0.01 <= state.unlearned <= state.p:
        yield other


def _votes(state: PooledState, observers: int, quorum: int) -> str:
    if observers < quorum:
        return f"{observers} of {quorum} observers needed {'is' if observers == 1 else 'are'} counted"
    if state.agreeing == 0:
        return f"no observer votes for {state.label}, {quorum} needed"
    vote = "votes" if state.agreeing == 1 else "vote"
    return f"{state.agreeing} of {quorum} observers needed {vote} for {state.label}"


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
