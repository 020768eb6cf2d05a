"""The fading of a posterior with its age: rules 3 and 7 of roster.py. Pure.

freshness: the exponent k of p <- (p/prior)^k prior, 1 (unchanged) to 0 (the prior), as in common/probability.py:temper.
"""

import math
from collections.abc import Sequence

import numpy as np

from common.probability import Floats, Surprise, decode_facing, encode_facing, normalise, temper, uniform


def freshness_after(seconds: float, constant_s: float) -> float:
    """The freshness after fading for so long with this time constant; 1 before the fading begins."""
    return 1.0 if seconds <= 0.0 else math.exp(-seconds / constant_s)


def faded_unlearned(p: Floats, unlearned: float, freshness: float) -> float:
    """`unlearned` after the posterior over all M+1 answers has faded; p (M,)."""
    answers = np.append(p * (1.0 - unlearned), unlearned)
    return float(temper(answers, uniform(len(answers)), freshness)[-1])


def faded_surprise(surprise: Surprise, freshness: float) -> Surprise:
    """(M, K) P(facing | movement)^freshness, encoded again so that the vote carries it as it was pooled."""
    return encode_facing(normalise(decode_facing(surprise) ** freshness))


def faded_facet(facet: Sequence[float], freshness: float) -> Sequence[float]:
    """(V,) a facet of V values, which fades towards the uniform distribution."""
    if len(facet) < 2:
        return facet
    faded: list[float] = temper(np.array(facet), uniform(len(facet)), freshness).tolist()
    return faded
