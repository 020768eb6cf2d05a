"""The exponents of the stacked model's members: one pair for movements in progress, one for ended movements. Pure."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from observer.model.base import Header
from observer.model.log_linear_pool import learn_exponents, pooled
from observer.model.parameters import NOT_NEGATIVE, Parameter
from observer.tracks import Floats

RUNNING = ("generative", "discriminative")
ENDED = ("generative_ended", "discriminative_ended")
RUNNING_AT = (0.3, 0.6, 0.9)
"""Shares of held-out movements from which the exponents for movements in progress are learned."""
EXPONENTS: Mapping[str, Parameter] = {  # `Stacked.cross_validated` learns them.
    "generative": Parameter(0.6, NOT_NEGATIVE),
    "discriminative": Parameter(1.0, NOT_NEGATIVE),
    "generative_ended": Parameter(0.6, NOT_NEGATIVE),
    "discriminative_ended": Parameter(1.0, NOT_NEGATIVE),
}


def learned_exponents(
    header: Header, members: Floats, truth: NDArray[np.int64], explicit: Collection[str]
) -> dict[str, float]:
    """From (N, T, 2, M) posteriors of both members, at RUNNING_AT first and at the end last."""
    result: dict[str, float] = {}
    for names, times in ((RUNNING, slice(0, len(RUNNING_AT))), (ENDED, slice(-1, None))):
        defaults = [header.parameters[name] for name in names]
        learned = learn_exponents(members[:, times], truth, defaults, [name in explicit for name in names])
        result.update(zip(names, learned, strict=True))
    return result


def pooled_at(shares: Sequence[float], members: Floats, exponents: Mapping[str, float]) -> Floats:
    """(T, 2, M) after these shares of a movement -> (T, M)."""
    names = [ENDED if share >= 1 else RUNNING for share in shares]
    return np.array([pooled(p, [exponents[name] for name in own]) for p, own in zip(members, names, strict=True)])
