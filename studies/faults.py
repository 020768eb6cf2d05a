"""Faulty observers for `labanmesh evaluate --fault VIEW=KIND`: changed input or output. Seeded, pure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.tracks import Frame, Tracker, Tracks

Floats = NDArray[np.float64]

FAULT_DELAY_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class ObserverOutputs:
    """Outputs in F frames of one trial: p (F, V, M), facing (F, V, M, K) or None, unlearned (F, V) or None."""

    p: Floats
    facing: Floats | None = None
    unlearned: Floats | None = None

    def of(self, view: int) -> "ObserverOutputs":
        """The outputs of one observer: p (F, M), facing (F, M, K), unlearned (F,)."""
        facing = None if self.facing is None else self.facing[:, view]
        return ObserverOutputs(self.p[:, view], facing, None if self.unlearned is None else self.unlearned[:, view])

    def with_view(self, view: int, outputs: "ObserverOutputs") -> "ObserverOutputs":
        """A copy in which one observer has other outputs."""
        result = ObserverOutputs(
            *(None if a is None else a.copy() for a in (self.p, self.facing, self.unlearned))  # type: ignore[arg-type]
        )
        result.p[:, view] = outputs.p
        if result.facing is not None and outputs.facing is not None:
            result.facing[:, view] = outputs.facing
        if result.unlearned is not None and outputs.unlearned is not None:
            result.unlearned[:, view] = outputs.unlearned
        return result

    def at(self, frames: NDArray[np.int64]) -> "ObserverOutputs":
        """The outputs in those frames."""
        facing = None if self.facing is None else self.facing[frames]
        return ObserverOutputs(self.p[frames], facing, None if self.unlearned is None else self.unlearned[frames])


def wrong(own: ObserverOutputs, other: ObserverOutputs, rate_hz: float, rng: np.random.Generator) -> ObserverOutputs:
    """Certain and wrong: the outputs of another trial, drawn blindly; its last frame is repeated if it is shorter.

    The other trial may happen to show the same movement.
    """
    return other.at(np.minimum(np.arange(len(own.p)), len(other.p) - 1))


def noise(own: ObserverOutputs, other: ObserverOutputs, rate_hz: float, rng: np.random.Generator) -> ObserverOutputs:
    """A new random posterior in every frame, from nearly certain to undecided; also over facings."""
    frames, movements = own.p.shape
    p = rng.dirichlet(np.full(movements, 0.2), size=frames)
    if own.facing is None:
        return ObserverOutputs(p, None, own.unlearned)
    facing = rng.dirichlet(np.full(own.facing.shape[2], 0.2), size=(frames, movements))
    return ObserverOutputs(p, facing, own.unlearned)


def silent(own: ObserverOutputs, other: ObserverOutputs, rate_hz: float, rng: np.random.Generator) -> ObserverOutputs:
    """No message: the prior in every frame."""
    facing = None if own.facing is None else np.full_like(own.facing, 1.0 / own.facing.shape[2])
    unlearned = None if own.unlearned is None else np.full_like(own.unlearned, np.nan)
    return ObserverOutputs(np.full_like(own.p, 1.0 / own.p.shape[1]), facing, unlearned)


def late(own: ObserverOutputs, other: ObserverOutputs, rate_hz: float, rng: np.random.Generator) -> ObserverOutputs:
    """All outputs one second late, the prior before."""
    delay = min(round(FAULT_DELAY_S * rate_hz), len(own.p))
    shifted = own.at(np.maximum(np.arange(len(own.p)) - delay, 0))
    before, prior = np.arange(len(own.p)) < delay, silent(own, other, rate_hz, rng)
    shifted.p[before] = prior.p[before]
    if shifted.facing is not None and prior.facing is not None:
        shifted.facing[before] = prior.facing[before]
    if shifted.unlearned is not None and prior.unlearned is not None:
        shifted.unlearned[before] = prior.unlearned[before]
    return shifted


Fault = Callable[[ObserverOutputs, ObserverOutputs, float, np.random.Generator], ObserverOutputs]
FAULTS: Mapping[str, Fault] = {"wrong": wrong, "noise": noise, "silent": silent, "late": late}
HIDDEN = "hidden"
"""A fault of the input: in the middle third of the movement no body part is visible."""


class OccludedTracker:
    """A tracker whose view is covered in frames first..end-1."""

    def __init__(self, tracker: Tracker, first: int, end: int) -> None:
        self.body_parts = tracker.body_parts
        self._tracker, self._covered, self._frame = tracker, range(first, end), -1

    def update(self, frame: Frame) -> Tracks:
        """The tracker's tracks; all missing while it is covered."""
        self._frame += 1
        tracks = self._tracker.update(frame)
        return Tracks(np.full_like(tracks.centres, np.nan)) if self._frame in self._covered else tracks


def parse_fault(text: str, views: Sequence[str]) -> tuple[str, str]:
    """`VIEW=KIND` -> (view, kind); raises BadInput that lists the known ones."""
    view, equals, kind = text.rpartition("=")
    if not equals or view not in views:
        raise BadInput(f"--fault {text!r}: VIEW=KIND is expected, VIEW one of {', '.join(views)}")
    if kind not in (*FAULTS, HIDDEN):
        raise BadInput(f"--fault {text!r}: unknown fault {kind!r}; known: {', '.join((*FAULTS, HIDDEN))}")
    return view, kind


def disturb(
    outputs: Sequence[ObserverOutputs], views: Sequence[str], faults: Mapping[str, str], rate_hz: float, seed: int
) -> list[ObserverOutputs]:
    """The outputs in each trial with those of the faulty views replaced; `hidden` acts on the input, not here."""
    rng = np.random.default_rng([seed, 1])
    result = list(outputs)
    for view, kind in faults.items():
        if kind not in FAULTS:
            continue
        column = list(views).index(view)
        for n, whole in enumerate(outputs):
            other = outputs[_another(n, len(outputs), rng)].of(column)
            result[n] = result[n].with_view(column, FAULTS[kind](whole.of(column), other, rate_hz, rng))
    return result


def _another(n: int, count: int, rng: np.random.Generator) -> int:
    return (n + int(rng.integers(1, count))) % count if count > 1 else n
