"""Offline classifiers (MiniRocket, 1-NN DTW) and the gap-free panels of tracks that they learn from.

A panel uses nothing after the requested frame: size, origin and bridging of gaps come from earlier frames.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.features.space import BodySize
from observer.geometry.views import View
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS, Floats
from studies.trials import Trial

Panel = NDArray[np.float64]


def watched(trial: Trial, views: Sequence[View], recorded: tuple[str, ...]) -> Floats:
    """(V, F, P, 2) centres of the hands and the head in every frame of a trial, as each view sees them."""
    return np.array([[t.centres for t in view_tracks(view, trial.recording, recorded, BODY_PARTS)] for view in views])


def panel(
    watched_trials: Sequence[Floats], trials: Sequence[Trial], fraction: float, length: int, derived: bool
) -> Panel:
    """(N, C, length): each trial until `fraction` of it has been seen, stretched or shrunk to `length` frames.

    C is V*6 positions; if derived, also the V*4 of the hands as seen from the head, and V*6 velocities.
    """
    return np.array(
        [
            channels(seen[:, trial.begin : trial.frame_at(fraction) + 1], length, derived)
            for seen, trial in zip(watched_trials, trials, strict=True)
        ]
    )


def channels(centres: Floats, length: int, derived: bool) -> Floats:
    """(V, F, P, 2) centres, v down -> (C, length): right and up from the first head, in body sizes, gaps bridged.

    Velocities are per frame as it was filmed, so that they still tell slow from fast when the length no longer does.
    """
    rows = np.concatenate([bridged(relative(view).reshape(len(view), -1).T) for view in centres])
    positions = resampled(rows, length)
    if not derived:
        return positions
    parts = positions.reshape(len(centres), len(BODY_PARTS), 2, length)
    head = BODY_PARTS.index("head")
    from_head = (np.delete(parts, head, axis=1) - parts[:, head, None]).reshape(-1, length)
    velocities = np.gradient(positions, axis=1) * ((length - 1) / max(rows.shape[1] - 1, 1))
    return np.concatenate([positions, from_head, velocities])


def relative(centres: Floats) -> Floats:
    """(F, P, 2) centres of one view, v down -> the same in body sizes, up positive, from where the head was first.

    The size is the body's when the last frame has been seen; unknown places stay NaN. A person whose head was never
    seen, or no hand with it, has no size, and counts as never seen.
    """
    reader = BodySize()
    size = [reader.update(frame, BODY_PARTS) for frame in centres][-1]
    head = centres[:, BODY_PARTS.index("head")]
    seen = np.isfinite(head).all(axis=1)
    first = head[seen.argmax()] if seen.any() else np.full(2, np.nan)
    placed: Floats = (centres - first) / size * (1.0, -1.0)
    return placed


def bridged(rows: Floats) -> Floats:
    """(C, F) -> the same without NaN: straight lines over gaps, held at the ends, 0 where nothing was ever seen."""
    result = np.zeros_like(rows)
    instants = np.arange(rows.shape[1])
    for row, seen in zip(range(len(rows)), np.isfinite(rows), strict=True):
        if seen.any():
            result[row] = np.interp(instants, instants[seen], rows[row, seen])
    return result


def resampled(rows: Floats, length: int) -> Floats:
    """(C, F) -> (C, length), linear in time from the first frame to the last."""
    instants = np.linspace(0, rows.shape[1] - 1, length)
    return np.array([np.interp(instants, np.arange(rows.shape[1]), row) for row in rows])


Names = NDArray[np.str_]

KERNELS = 10_000
KERNELS_FAST = 1_000
DTW_WINDOW = 0.2
"""How far, as a share of the length, one movement may be ahead of the other."""


@dataclass(frozen=True, slots=True)
class Peer:
    """An offline classifier. judged: (training panel, its labels, test panel, seed, fast) -> labels of the test panel.

    length: frames of its panels. derived: whether they have more than positions. by_chance: whether another seed may
    judge otherwise.
    """

    judged: Callable[[Panel, Names, Panel, int, bool], Names]
    length: int
    derived: bool
    by_chance: bool


def _minirocket(learned: Panel, labels: Names, unknown: Panel, seed: int, fast: bool) -> Names:
    from aeon.classification.convolution_based import MiniRocketClassifier

    # The default is a ridge classifier whose penalty is found by cross-validation among what is learned from.
    classifier = MiniRocketClassifier(n_kernels=KERNELS_FAST if fast else KERNELS, random_state=seed)
    return np.asarray(classifier.fit(learned, labels).predict(unknown))


def _nearest(learned: Panel, labels: Names, unknown: Panel, seed: int, fast: bool) -> Names:
    from aeon.classification.distance_based import KNeighborsTimeSeriesClassifier

    classifier = KNeighborsTimeSeriesClassifier(n_neighbors=1, distance="dtw", distance_params={"window": DTW_WINDOW})
    with warnings.catch_warnings():
        # What numba says of aeon's own code when it compiles it; nobody here can act on it.
        warnings.filterwarnings("ignore", "unsafe cast from uint64 to int64")
        return np.asarray(classifier.fit(learned, labels).predict(unknown))


PEERS: Mapping[str, Peer] = {
    "MiniRocket": Peer(_minirocket, length=64, derived=True, by_chance=True),
    "1-NN DTW": Peer(_nearest, length=40, derived=False, by_chance=False),
}
