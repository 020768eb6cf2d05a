"""What a model of few takes by several people makes of its members and of the nearest take. Pure.

Exponents, temperature and scales of something else that are learned by leaving out one of three people are mostly
chance, and so cautious that half of the movements get no name. How far each source can be trusted is therefore the same
for all such models: the weights below are those of least log loss (multinomial, and logistic for something else) on
takes left out of models of three movements, two to five takes of each: subjects 1, 7 and 9 of MSR Action3D in two views
and the six people of Northwestern-UCLA, beside their other movements and a stranger's storytelling
(docs/results/notebook.md, "Few takes").
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
BLEND: Mapping[str, Parameter] = {FEW_TAKES: Parameter(1.0, PROBABILITY, earlier=0.0)}
"""1: a model of few takes by several people judges by this module; 0: by learned exponents and `nearest_weight`."""
MOST_MOVEMENTS = 8
"""The weights were chosen for three movements and tried with four; models of more learn their exponents, as before."""
CALIBRATION = PosteriorCalibration(doubt=0.02, learned_only=True)
"""The weights were chosen for the posterior as it is."""
PHASE, DISCRIMINATIVE, NEAREST = 0.22, 0.31, 0.42
"""Exponents of the members, and nats for each distance between takes."""
FARTHEST = 6.0
"""Distances between takes: farther is not worse. A movement of which too little was seen to compare it is as far."""
OFFSET, TRAILING, FAR, AGREEMENT, ENTROPY = -1.70, 0.49, 1.16, -0.32, 0.23
"""Log odds of something else: in general, for each nat by the trailing windows, for each distance from the nearest take
of the likeliest movement (none while it cannot be compared), for each nat by which the members agree, and for each nat
of entropy of the posterior."""
MOST_TRAILING = 6.0
COMMON_OFFSET = -2.70
"""OFFSET of a model that learned common gestures: its trailing windows know more of something else."""


def blends(header: Header, examples: Iterable[Example]) -> bool:
    """Whether a model that compares with takes judges by this module: takes of several people, few movements."""
    people = {example.subject for example in examples if example.movement >= 0}
    return bool(header.parameters[FEW_TAKES]) and len(people) > 1 and header.vocabulary.size <= MOST_MOVEMENTS


def pooled_with_takes(phase: Floats, discriminative: Floats, far: Floats) -> Floats:
    """(..., M) posteriors of both members, (..., M) distances between takes, inf if unknown -> (..., M) posterior."""
    logs = PHASE * np.log(np.maximum(phase, SMALLEST)) + DISCRIMINATIVE * np.log(np.maximum(discriminative, SMALLEST))
    return softmax(logs - NEAREST * np.minimum(far, FARTHEST))


def something_else_with_takes(
    phase: Floats, discriminative: Floats, far: Floats, trailing: float, offset: float = OFFSET
) -> float:
    """P(something else). trailing: the same by the trailing windows; the others as for `pooled_with_takes`, (M,)."""
    p = pooled_with_takes(phase, discriminative, far)
    nearest = float(far[int(p.argmax())])
    odds = math.log(max(trailing, 1e-9) / max(1.0 - trailing, 1e-9))
    nats = offset + TRAILING * min(max(odds, -MOST_TRAILING), MOST_TRAILING)
    nats += FAR * min(nearest, FARTHEST) if math.isfinite(nearest) else 0.0
    nats += AGREEMENT * float(agreement_of(np.array([phase, discriminative]), np.eye(len(p))))
    nats -= ENTROPY * float(p @ np.log(np.maximum(p, 1e-12)))
    return 1.0 / (1.0 + math.exp(-nats))
