"""Judges that go wrong, for `labanmesh evaluate --fault VIEW=KIND`: what they see or say instead. Seeded, pure."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.tracks import Frame, Tracker, Tracks

Floats = NDArray[np.float64]

LATE_S = 1.0


def wrong(own: Floats, other: Floats, rate_hz: float, rng: np.random.Generator) -> Floats:
    """Sure, and of another trial: what this judge believed when it saw that. Its last frame stays, where it is shorter.

    Which trial is drawn blindly, so that it is now and then the same movement.
    """
    place = np.minimum(np.arange(len(own)), len(other) - 1)
    return other[place]


def noise(own: Floats, other: Floats, rate_hz: float, rng: np.random.Generator) -> Floats:
    """A new random belief in every frame, from nearly certain to undecided."""
    return rng.dirichlet(np.full(own.shape[1], 0.2), size=len(own))


def silent(own: Floats, other: Floats, rate_hz: float, rng: np.random.Generator) -> Floats:
    """Says nothing: the prior."""
    return np.full_like(own, 1.0 / own.shape[1])


def late(own: Floats, other: Floats, rate_hz: float, rng: np.random.Generator) -> Floats:
    """Says everything a second late, and nothing before."""
    delay = min(round(LATE_S * rate_hz), len(own))
    return np.concatenate([silent(own[:delay], other, rate_hz, rng), own[: len(own) - delay]])


FAULTS: Mapping[str, Callable[[Floats, Floats, float, np.random.Generator], Floats]] = {
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
    beliefs: Sequence[Floats], views: Sequence[str], faults: Mapping[str, str], rate_hz: float, seed: int
) -> list[Floats]:
    """Per trial (F, V, M) beliefs -> the same with those of the views replaced whose fault is in what they say."""
    rng = np.random.default_rng([seed, 1])
    result = [b.copy() for b in beliefs]
    for view, kind in faults.items():
        if kind not in FAULTS:
            continue
        column = list(views).index(view)
        for n, own in enumerate(beliefs):
            other = beliefs[_another(n, len(beliefs), rng)][:, column]
            result[n][:, column] = FAULTS[kind](own[:, column], other, rate_hz, rng)
    return result


def _another(n: int, count: int, rng: np.random.Generator) -> int:
    return (n + int(rng.integers(1, count))) % count if count > 1 else n
