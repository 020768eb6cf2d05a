"""What is left of the parts of a posterior at its age: rules 3 and 7 of roster.py. Pure.

exponent: 1 leaves all of it, 0 nothing; as in common/probability.py:temper, by which movements fade.
"""

import math

import numpy as np

from common.probability import Floats, Surprise, decode_facing, encode_facing, normalise, temper, uniform


def left_after(seconds: float, constant_s: float) -> float:
    """The exponent after fading for so long; 1 before the fading begins."""
    return 1.0 if seconds <= 0.0 else math.exp(-seconds / constant_s)


def faded_unlearned(p: Floats, unlearned: float, exponent: float) -> float:
    """`unlearned` after the posterior over all answers has faded; p (M,)."""
    answers = np.append(p * (1.0 - unlearned), unlearned)
    return float(temper(answers, uniform(len(answers)), exponent)[-1])


def faded_surprise(surprise: Surprise, exponent: float) -> Surprise:
    """(M, K) P(facing | movement)^exponent, encoded again so that the vote carries it as it was pooled."""
    return encode_facing(normalise(decode_facing(surprise) ** exponent))


def faded_facet(facet: Floats, exponent: float) -> Floats:
    """(V,) a facet of V values, which fades towards the uniform distribution."""
    return facet if len(facet) < 2 else temper(facet, uniform(len(facet)), exponent)
