"""Events before a trial, `labanmesh evaluate --room EVENT=NUMBER`: the person walks in, comes nearer. Seeded, pure.

Real rooms expose what cut-out recordings hide: features that remember an earlier place or size of the person.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput

Positions = NDArray[np.floating]

NOISE_M = 0.01
"""Trembling of a tracked hand at rest: in the quiet half of the recordings it moves 0.8 to 3 cm a frame."""
STAND_S = 1.0
"""The person stands this long between the last event and the movement."""
WALK_M_S = 1.0
NEARER_S = 3.0
STRANGER_S = 2.0
ABSENT_S = 2.0


@dataclass(frozen=True, slots=True)
class RoomEvent:
    """One event before a trial. number: metres for `walk`, otherwise a factor of the body's size."""

    kind: str
    number: float


def before_trial(
    events: Sequence[RoomEvent], first: Positions, rate_hz: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """(P, 3) the trial's first posture -> (F, P, 3) the events in their order, then STAND_S of standing."""
    standing = np.repeat(first[None], round(STAND_S * rate_hz), axis=0)
    pieces = [EVENTS[e.kind](first, e.number, rate_hz, rng) for e in events if e.kind != BLUNDER]
    for event in events:
        if event.kind == BLUNDER:
            standing = blunder(standing, event.number)
    whole = np.concatenate([*pieces, standing])
    return (whole + rng.normal(0, NOISE_M, whole.shape)).astype(np.float32)


def walk(first: Positions, metres: float, rate_hz: float, rng: np.random.Generator) -> Positions:
    """The posture comes from `metres` away, from a random side, at WALK_M_S on average; it starts and stops gently."""
    angle = rng.uniform(0, 2 * np.pi)
    aside = metres * np.array([np.cos(angle), 0.0, np.sin(angle)])
    left = 1 - _smooth(round(metres / WALK_M_S * rate_hz))
    return first + left[:, None, None] * aside


def nearer(first: Positions, factor: float, rate_hz: float, rng: np.random.Generator) -> Positions:
    """The posture grows from 1/factor to its size within NEARER_S, as in the image of a camera that it approaches."""
    grown = np.exp((_smooth(round(NEARER_S * rate_hz)) - 1) * np.log(factor))
    return _scaled(first, grown)


def stranger(first: Positions, factor: float, rate_hz: float, rng: np.random.Generator) -> Positions:
    """A person `factor` times as tall stands there for STRANGER_S; then no person is seen for ABSENT_S."""
    other = _scaled(first, np.full(round(STRANGER_S * rate_hz), factor))
    return np.concatenate([other, np.full((round(ABSENT_S * rate_hz), *first.shape), np.nan)])


def blunder(standing: Positions, factor: float) -> Positions:
    """(F, P, 3) -> the same, with the body `factor` times as large in the middle frame: one error of the tracker."""
    middle = len(standing) // 2
    return np.concatenate([standing[:middle], _scaled(standing[middle], np.array([factor])), standing[middle + 1 :]])


BLUNDER = "blunder"
EVENTS: Mapping[str, Callable[[Positions, float, float, np.random.Generator], Positions]] = {
    "walk": walk,
    "nearer": nearer,
    "stranger": stranger,
}


def parse_event(text: str) -> RoomEvent:
    """`walk=1.5` -> the event; raises BadInput that lists the known events."""
    kind, equals, number = text.partition("=")
    known = (*EVENTS, BLUNDER)
    if not equals or kind not in known:
        raise BadInput(f"--room {text!r}: EVENT=NUMBER is expected, EVENT one of {', '.join(known)}")
    try:
        value = float(number)
    except ValueError:
        value = np.nan
    lowest, highest = (0.0, 100.0) if kind == "walk" else (0.1, 10.0)
    if not lowest <= value <= highest:
        raise BadInput(f"--room {text!r}: {kind} takes a number from {lowest:g} to {highest:g}")
    return RoomEvent(kind, value)


def _smooth(frames: int) -> NDArray[np.float64]:
    """(frames,) from 0 to just below 1, slow at both ends."""
    share = np.arange(frames) / max(frames, 1)
    smooth: NDArray[np.float64] = share * share * (3 - 2 * share)
    return smooth


def _scaled(first: Positions, factors: NDArray[np.float64]) -> Positions:
    """(P, 3), (F,) -> (F, P, 3): the posture at each size; its mean stays in place."""
    known = np.isfinite(first).all(axis=1)
    centre = first[known].mean(axis=0) if known.any() else np.zeros(3)
    scaled: Positions = centre + (first - centre) * factors[:, None, None]
    return scaled
