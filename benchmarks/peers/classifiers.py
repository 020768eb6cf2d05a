"""Offline classifiers (MiniRocket, 1-NN DTW) and the gap-free panels of tracks that they learn from.

A panel uses nothing after the requested frame: size, origin and bridging of gaps come from earlier frames.
aeon is imported when a classifier learns.

Dempster, Schmidt and Webb, "MiniRocket: a very fast (almost) deterministic transform for time series classification",
KDD 2021. The parameters were chosen among training people (docs/results/peers.md).
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.features import BodySize
from observer.geometry.views import View
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS, Floats
from studies.trials import EvaluationTrial

Panel = NDArray[np.float64]
Names = NDArray[np.str_]

KERNELS = 10_000
KERNELS_FAST = 1_000
DTW_WINDOW = 0.2
"""How far, as a share of the length, one movement may be ahead of the other."""


def view_centres(trial: EvaluationTrial, views: Sequence[View], recorded: tuple[str, ...]) -> Floats:
    """(V, F, P, 2) centres of hands and head in every frame of a trial, by view."""
    return np.array([[t.centres for t in view_tracks(view, trial.recording, recorded, BODY_PARTS)] for view in views])


def make_panel(
    centres: Sequence[Floats], trials: Sequence[EvaluationTrial], fraction: float, length: int, derived: bool
) -> Panel:
    """(N, C, length): each trial up to `fraction` of it, resampled to `length` frames.

    C is V*6 positions; if derived, also V*4 positions of the hands relative to the head, and V*6 velocities.
    """
    return np.array(
        [
            channels(own[:, trial.begin : trial.frame_at(fraction) + 1], length, derived)
            for own, trial in zip(centres, trials, strict=True)
        ]
    )


def channels(centres: Floats, length: int, derived: bool) -> Floats:
    """(V, F, P, 2) centres, v down -> (C, length): right and up from the first head, in body sizes, gaps bridged.

    Velocities are per recorded frame, so that they still distinguish slow from fast after resampling.
    """
    rows = np.concatenate([bridge_gaps(relative(view).reshape(len(view), -1).T) for view in centres])
    positions = resample_rows(rows, length)
    if not derived:
        return positions
    parts = positions.reshape(len(centres), len(BODY_PARTS), 2, length)
    head = BODY_PARTS.index("head")
    from_head = (np.delete(parts, head, axis=1) - parts[:, head, None]).reshape(-1, length)
    velocities = np.gradient(positions, axis=1) * ((length - 1) / max(rows.shape[1] - 1, 1))
    return np.concatenate([positions, from_head, velocities])


def relative(centres: Floats) -> Floats:
    """(F, P, 2) centres of one view, v down -> in body sizes, up positive, relative to the first visible head.

    The body size is that after the last frame; unknown places stay NaN. Without a visible head, or without a hand
    visible together with it, the size is unknown and everything is NaN.
    """
    reader = BodySize()
    size = [reader.update(frame, BODY_PARTS) for frame in centres][-1]
    head = centres[:, BODY_PARTS.index("head")]
    visible = np.isfinite(head).all(axis=1)
    first = head[visible.argmax()] if visible.any() else np.full(2, np.nan)
    placed: Floats = (centres - first) / size * (1.0, -1.0)
    return placed


def bridge_gaps(rows: Floats) -> Floats:
    """(C, F) -> the same without NaN: straight lines over gaps, constant at the ends, 0 where all is NaN."""
    result = np.zeros_like(rows)
    instants = np.arange(rows.shape[1])
    for row, visible in zip(range(len(rows)), np.isfinite(rows), strict=True):
        if visible.any():
            result[row] = np.interp(instants, instants[visible], rows[row, visible])
    return result


def resample_rows(rows: Floats, length: int) -> Floats:
    """(C, F) -> (C, length), linear in time from the first frame to the last."""
    instants = np.linspace(0, rows.shape[1] - 1, length)
    return np.array([np.interp(instants, np.arange(rows.shape[1]), row) for row in rows])


@dataclass(frozen=True, slots=True)
class Peer:
    """An offline classifier. predict: (training panel, labels, test panel, seed, fast) -> labels of the test panel.

    length: frames of its panels. derived: see make_panel. random: whether the result depends on the seed.
    """

    predict: Callable[[Panel, Names, Panel, int, bool], Names]
    length: int
    derived: bool
    random: bool


def _minirocket(train: Panel, labels: Names, test: Panel, seed: int, fast: bool) -> Names:
    from aeon.classification.convolution_based import MiniRocketClassifier

    # By default a ridge classifier whose penalty is cross-validated on the training panel.
    classifier = MiniRocketClassifier(n_kernels=KERNELS_FAST if fast else KERNELS, random_state=seed)
    return np.asarray(classifier.fit(train, labels).predict(test))


def _nearest(train: Panel, labels: Names, test: Panel, seed: int, fast: bool) -> Names:
    from aeon.classification.distance_based import KNeighborsTimeSeriesClassifier

    classifier = KNeighborsTimeSeriesClassifier(n_neighbors=1, distance="dtw", distance_params={"window": DTW_WINDOW})
    with warnings.catch_warnings():
        # numba warns about aeon's own code when it compiles it.
        warnings.filterwarnings("ignore", "unsafe cast from uint64 to int64")
        return np.asarray(classifier.fit(train, labels).predict(test))


PEERS: Mapping[str, Peer] = {
    "MiniRocket": Peer(_minirocket, length=64, derived=True, random=True),
    "1-NN DTW": Peer(_nearest, length=40, derived=False, random=False),
}
