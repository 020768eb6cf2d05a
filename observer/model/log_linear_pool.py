"""Multiplies posteriors of several members with exponents, and learns the exponents. Pure.

Genest and Zidek, "Combining probability distributions: a critique and an annotated bibliography", Statistical Science
1, 1986: the log-linear pool. Exponents are learned from examples that no member has learned from, as in Wolpert,
"Stacked generalization", Neural Networks 5, 1992.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from common.probability import softmax
from observer.tracks import Floats

SMALLEST = 1e-4
"""Floor of a member's probability: no member can veto a movement alone."""
CHOICES = np.linspace(0.0, 2.0, 21)
PRIOR = 10.0
"""Nats for an exponent that is 1 away from its default: with few examples exponents stay near it."""


def pooled(members: Floats, exponents: Sequence[float]) -> Floats:
    """(..., J, M) posteriors of J members -> (..., M) the pool's posterior."""
    return softmax(np.tensordot(np.log(np.maximum(members, SMALLEST)), exponents, axes=([-2], [0])))


def learn_exponents(
    members: Floats, truth: NDArray[np.int64], defaults: Sequence[float], explicit: Sequence[bool]
) -> tuple[float, ...]:
    """(N, T, J, M) posteriors of N held-out examples at T times, (N,) the right movements -> J exponents.

    Those of least log loss among CHOICES, plus PRIOR times the squared distance from the defaults; explicit exponents
    keep their default.
    """
    if not len(members):
        return tuple(defaults)
    choices = [(d,) if e else (*CHOICES.tolist(), d) for d, e in zip(defaults, explicit, strict=True)]
    best = (np.inf, tuple(defaults))
    for exponents in product(*choices):
        right = pooled(members, exponents)[np.arange(len(truth)), :, truth]
        loss = -float(np.log(np.maximum(right, 1e-12)).mean(axis=1).sum())
        loss += PRIOR * float(np.square(np.subtract(exponents, defaults)).sum())
        best = min(best, (loss, exponents))
    return best[1]
