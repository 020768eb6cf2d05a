"""Probability vectors over movements: normalising, entropy, tempering, compact facings. Pure functions on arrays."""

import math
import struct
from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from common.message_types import ROOT_LIMIT, SURPRISE_LIMIT

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Surprise = Integers
SMALLEST = 1e-300
"""Stands for 0 in a logarithm and a divisor: a zero stays an almost absolute veto, and two of them give no NaN."""

_ROOT_LIMIT, _HALF = np.array(float(ROOT_LIMIT)), np.array(0.5)
"""Beside an array NumPy takes arrays of no dimension in two thirds of the time of a Python number."""
SURPRISE_UNIT = 8.0
"""Surprise is -8 ln P: one unit is a factor of 0.88, precise enough to be multiplied."""


def uniform(size: int) -> Floats:
    """(M,) the uniform distribution, the posterior of an observer that has seen nothing."""
    return np.full(size, 1.0 / size)


def array_of(values: Sequence[float]) -> Floats:
    """(M,) a list of floats, read-only; in half the time of `np.array`."""
    return np.frombuffer(_doubles(len(values)).pack(*values))


@cache
def _doubles(size: int) -> struct.Struct:
    return struct.Struct(f"{size}d")


def softmax(log_p: Floats) -> Floats:
    """(..., M) unnormalised log probabilities -> (..., M) probabilities that sum to 1 along the last axis.

    The maximum is subtracted before exp. A row of -inf carries no information and becomes uniform.
    """
    top = log_p.max(axis=-1, keepdims=True)
    return normalise(np.exp(log_p - np.where(np.isfinite(top), top, 0.0)))


def normalise(mass: Floats) -> Floats:
    """(..., M) non-negative masses -> (..., M) probabilities; rows without any mass become uniform."""
    total = mass.sum(axis=-1, keepdims=True)
    return np.where(total > 0, mass / np.where(total > 0, total, 1.0), 1.0 / mass.shape[-1])


def entropy_bits(p: Floats) -> Floats:
    """(..., M) -> (...) entropy H = -sum p log2 p in bits, 0 <= H <= log2 M, with 0 log 0 = 0 (section V.B).

    Round-off below zero is cut off and the result is never -0.0, because 1/H is used as a weight.
    """
    # Subtracted from 0.0, because the negative of a sum of 0.0 is -0.0.
    h = 0.0 - np.add.reduce(p * np.log2(np.maximum(p, SMALLEST)), axis=-1)
    result: Floats = np.minimum(np.maximum(h, 0.0), math.log2(p.shape[-1]))
    return result


def temper(p: Floats, prior: Floats, exponent: float) -> Floats:
    """(M,) posterior -> (p/prior)^exponent * prior, normalised: exponent 1 is the identity, 0 gives the prior.

    An old posterior fades in this way, with exponent = exp(-age/tau). Movements that the prior excludes stay excluded.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        log_prior = np.log(prior)
        log_ratio = np.where(prior > 0, np.log(p) - log_prior, 0.0)
        # 0 * -inf is undefined; an exponent of 0 forgets even a certainty.
        powered = log_ratio * exponent if exponent > 0 else np.zeros_like(log_ratio)
    return softmax(powered + log_prior)


def encode_facing(facing: Floats) -> Surprise:
    """(M, K) P(facing | movement) -> (M, K) integers from 0 to SURPRISE_LIMIT, for a message."""
    least = np.exp(-SURPRISE_LIMIT / SURPRISE_UNIT)
    surprise: Surprise = np.rint(-SURPRISE_UNIT * np.log(np.maximum(facing, least))).astype(np.int64)
    return np.clip(surprise, 0, SURPRISE_LIMIT)


def decode_facing(surprise: Surprise) -> Floats:
    """(M, K) integers -> (M, K) P(facing | movement), each row summing to 1."""
    return normalise(np.exp((surprise.min(axis=1, keepdims=True) - surprise) / SURPRISE_UNIT))


def roots_of(p: Floats) -> Integers:
    """(..., M) probabilities -> integers, 255 sqrt(p) rounded, for short votes; `p_of_roots` is the inverse.

    They take one byte in a message, and are precise to .004 of a probability near 1, to .0004 of one near .01.
    """
    roots: Integers = (np.sqrt(p) * _ROOT_LIMIT + _HALF).astype(np.int64)
    return roots
