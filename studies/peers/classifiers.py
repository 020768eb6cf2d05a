"""The peers: aeon's MiniRocket, and the nearest neighbour by dynamic time warping. aeon is loaded when one learns.

Dempster, Schmidt and Webb, "MiniRocket: a very fast (almost) deterministic transform for time series classification",
KDD 2021. What is set here was chosen among training people (docs/results/peers.md).
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from studies.peers.panels import Panel

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
