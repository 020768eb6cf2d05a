"""Judges that go wrong, for `labanmesh evaluate --fault VIEW=KIND`: what they see or say instead. Seeded, pure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.tracks import Frame, Tracker, Tracks

Floats = NDArray[np.float64]

LATE_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Said:
    """What was said in F frames of one trial: p (F, V, M), facing (F, V, M, K) or None, unlearned (F, V) or None."""

    p: Floats
    facing: Floats | None = None
    unlearned: Floats | None = None

    def of(self, view: int) -> "Said":
        """What one observer said: p (F, M), facing (F, M, K), unlearned (F,)."""
        facing = None if self.facing is None else self.facing[:, view]
        return Said(self.p[:, view], facing, None if self.unlearned is None else self.unlearned[:, view])

    def with_view(self, view: int, said: "Said") -> "Said":
        """The same, another thing said by one observer."""
        result = Said(*(None if a is None else a.copy() for a in (self.p, self.facing, self.unlearned)))  # type: ignore[arg-type]
        result.p[:, view] = said.p
        if result.facing is not None and said.facing is not None:
            result.facing[:, view] = said.facing
        if result.unlearned is not None and said.unlearned is not None:
            result.unlearned[:, view] = said.unlearned
        return result

    def at(self, frames: NDArray[np.int64]) -> "Said":
        """What was said in those frames."""
        facing = None if self.facing is None else self.facing[frames]
        return Said(self.p[frames], facing, None if self.unlearned is None else self.unlearned[frames])


def wrong(own: Said, other: Said, rate_hz: float, rng: np.random.Generator) -> Said:
    """Sure, and of another trial: what this judge believed when it saw that. Its last frame stays, where it is shorter.

    Which trial is drawn blindly, so that it is now and then the same movement.
    """
    return other.at(np.minimum(np.arange(len(own.p)), len(other.p) - 1))


def noise(own: Said, other: Said, rate_hz: float, rng: np.random.Generator) -> Said:
    """A new random belief in every frame, from nearly certain to undecided; of facing too."""
    frames, movements = own.p.shape
    p = rng.dirichlet(np.full(movements, 0.2), size=frames)
    if own.facing is None:
        return Said(p, None, own.unlearned)
    return Said(p, rng.dirichlet(np.full(own.facing.shape[2], 0.2), size=(frames, movements)), own.unlearned)


def silent(own: Said, other: Said, rate_hz: float, rng: np.random.Generator) -> Said:
    """Says nothing: the prior."""
    facing = None if own.facing is None else np.full_like(own.facing, 1.0 / own.facing.shape[2])
    unlearned = None if own.unlearned is None else np.full_like(own.unlearned, np.nan)
    return Said(np.full_like(own.p, 1.0 / own.p.shape[1]), facing, unlearned)


def late(own: Said, other: Said, rate_hz: float, rng: np.random.Generator) -> Said:
    """Says everything a second late, and nothing before."""
    delay = min(round(LATE_S * rate_hz), len(own.p))
    then = own.at(np.maximum(np.arange(len(own.p)) - delay, 0))
    before, nothing = np.arange(len(own.p)) < delay, silent(own, other, rate_hz, rng)
    then.p[before] = nothing.p[before]
    if then.facing is not None and nothing.facing is not None:
        then.facing[before] = nothing.facing[before]
    if then.unlearned is not None and nothing.unlearned is not None:
        then.unlearned[before] = nothing.unlearned[before]
    return then


FAULTS: Mapping[str, Callable[[Said, Said, float, np.random.Generator], Said]] = {
    "wrong": wrong,
    "noise": noise,
    "silent": silent,
    "late": late,
}


HIDDEN = "hidden"
"""The fault of the eyes: in the middle third of the movement no body part is seen."""


class Hidden:
    """A tracker before which something stands in frames first..end-1 of what it is shown."""

    def __init__(self, tracker: Tracker, first: int, end: int) -> None:
        self.body_parts = tracker.body_parts
        self._tracker, self._covered, self._frame = tracker, range(first, end), -1

    def update(self, frame: Frame) -> Tracks:
        """As the tracker's; all missing while it is covered."""
        self._frame += 1
        tracks = self._tracker.update(frame)
        return Tracks(np.full_like(tracks.centres, np.nan)) if self._frame in self._covered else tracks


def fault_named(text: str, views: Sequence[str]) -> tuple[str, str]:
    """`VIEW=KIND` -> (view, kind); raises BadInput that names the known ones."""
    view, equals, kind = text.rpartition("=")
    if not equals or view not in views:
        raise BadInput(f"--fault {text!r}: VIEW=KIND is wanted, VIEW one of {', '.join(views)}")
    if kind not in (*FAULTS, HIDDEN):
        raise BadInput(f"--fault {text!r}: {kind!r} is no fault; known: {', '.join((*FAULTS, HIDDEN))}")
    return view, kind


def disturb(
    said: Sequence[Said], views: Sequence[str], faults: Mapping[str, str], rate_hz: float, seed: int
) -> list[Said]:
    """What was said in each trial -> the same with that of the views replaced whose fault is in what they say."""
    rng = np.random.default_rng([seed, 1])
    result = list(said)
    for view, kind in faults.items():
        if kind not in FAULTS:
            continue
        column = list(views).index(view)
        for n, whole in enumerate(said):
            other = said[_another(n, len(said), rng)].of(column)
            result[n] = result[n].with_view(column, FAULTS[kind](whole.of(column), other, rate_hz, rng))
    return result


def _another(n: int, count: int, rng: np.random.Generator) -> int:
    return (n + int(rng.integers(1, count))) % count if count > 1 else n
