"""Which way a person faces, as it travels: P(facing | movement) in whole numbers of surprise. Pure."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Surprise = NDArray[np.int64]

UNIT = 8.0
"""Surprise is -8 ln P: one more is a twelfth less likely, near enough to be multiplied."""
LIMIT = 255
"""Nothing is less likely than e^-32 on the wire."""


def surprise_of(facing: Floats) -> Surprise:
    """(M, K) P(facing | movement) -> (M, K) whole numbers, 0 to LIMIT."""
    surprise: Surprise = np.rint(-UNIT * np.log(np.maximum(facing, np.exp(-LIMIT / UNIT)))).astype(np.int64)
    return np.clip(surprise, 0, LIMIT)


def facing_from(surprise: Surprise) -> Floats:
    """(M, K) whole numbers -> (M, K) P(facing | movement), each row summing to 1."""
    mass = np.exp((surprise.min(axis=1, keepdims=True) - surprise) / UNIT)
    facing: Floats = mass / mass.sum(axis=1, keepdims=True)
    return facing
