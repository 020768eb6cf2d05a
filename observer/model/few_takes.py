"""The posterior of a model of few takes by several people: both members and the nearest take, with fixed weights. Pure.

Exponents, temperature and scales of something else that are learned by leaving out one of three people are mostly
chance, and so cautious that half of the movements get no name. So all models of few takes share the weights below:
those of least log loss (multinomial, and logistic for something else) on takes left out of models of three movements,
two to five takes of each: subjects 1, 7 and 9 of MSR Action3D in two views and the six people of Northwestern-UCLA,
beside their other movements and a stranger's storytelling (docs/results/notebook.md, "Few takes").

    P(m) proportional to phase(m)^PHASE discriminative(m)^DISCRIMINATIVE exp(-DISTANCE d(m))
    ln odds of something else = OFFSET + ELSE_TRAILING ln odds(trailing windows) + ELSE_DISTANCE d(m*)
                                + ELSE_AGREEMENT a + ELSE_ENTROPY H(P)

d: relative distance from the nearest take (`nearest_take.py`), m*: the likeliest movement, a: log of the probability
that both members agree (`something_else.agreement_of`), H: entropy in nats.
"""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from common.probability import softmax
from observer.model.base import Example, Header
from observer.model.log_linear_pool import SMALLEST
from observer.model.parameters import PROBABILITY, Parameter
from observer.model.posterior_calibration import PosteriorCalibration
from observer.model.something_else import agreement_of
from observer.tracks import Floats

FEW_TAKES = "few_takes"
PARAMETERS: Mapping[str, Parameter] = {FEW_TAKES: Parameter(1.0, PROBABILITY, earlier=0.0)}
"""1: a model of few takes by several people judges by this module; 0: by learned exponents and `nearest_weight`."""
MOST_MOVEMENTS = 8
"""The weights were chosen for three movements and tried with four; models of more movements learn their exponents."""
CALIBRATION = PosteriorCalibration(doubt=0.02, learned_only=True)
"""The weights were chosen for the posterior as it is."""
PHASE, DISCRIMINATIVE, DISTANCE = 0.22, 0.31, 0.42
"""Exponents of both members' posteriors, and nats for each unit of relative distance."""
FARTHEST = 6.0
"""Larger relative distances count as this. So does a movement that cannot be compared with its takes yet."""
OFFSET = -1.70
ELSE_TRAILING, ELSE_DISTANCE, ELSE_AGREEMENT, ELSE_ENTROPY = 0.49, 1.16, -0.32, 0.23
MOST_TRAILING = 6.0
"""Largest log odds of the trailing windows, either way."""
COMMON_OFFSET = -2.70
"""OFFSET of a model that learned common gestures: its trailing windows know more of something else."""


def judges_by_takes(header: Header, examples: Iterable[Example]) -> bool:
    """Whether a model that compares with takes judges by this module: takes of several people, few movements."""
    people = {example.subject for example in examples if example.movement >= 0}
    return bool(header.parameters[FEW_TAKES]) and len(people) > 1 and header.vocabulary.size <= MOST_MOVEMENTS


def pooled_with_takes(phase: Floats, discriminative: Floats, distances: Floats) -> Floats:
    """(..., M) posterior from both members' posteriors (..., M) and relative distances (..., M), inf if unknown."""
    logs = PHASE * np.log(np.maximum(phase, SMALLEST)) + DISCRIMINATIVE * np.log(np.maximum(discriminative, SMALLEST))
    return softmax(logs - DISTANCE * np.minimum(distances, FARTHEST))


def something_else_with_takes(
    phase: Floats, discriminative: Floats, distances: Floats, trailing: float, offset: float = OFFSET
) -> float:
    """P(something else), 0 to 1. trailing: the same by the trailing windows alone; the others (M,) as above.

    An unknown distance of the likeliest movement is no evidence.
    """
    p = pooled_with_takes(phase, discriminative, distances)
    nearest = float(distances[int(p.argmax())])
    odds = math.log(max(trailing, 1e-9) / max(1.0 - trailing, 1e-9))
    nats = offset + ELSE_TRAILING * min(max(odds, -MOST_TRAILING), MOST_TRAILING)
    nats += ELSE_DISTANCE * min(nearest, FARTHEST) if math.isfinite(nearest) else 0.0
    nats += ELSE_AGREEMENT * float(agreement_of(np.array([phase, discriminative]), np.eye(len(p))))
    nats -= ELSE_ENTROPY * float(p @ np.log(np.maximum(p, 1e-12)))
    return 1.0 / (1.0 + math.exp(-nats))
