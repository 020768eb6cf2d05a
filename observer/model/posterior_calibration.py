"""Calibrates a model's posteriors: temperature and uniform mixing so that a probability of 0.8 is right 8 times in 10.

A model that learns by itself how sure it may be needs neither. Pure; docs/design/model.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from common.probability import Floats, softmax

if TYPE_CHECKING:
    from observer.model.base import Watch

TEMPERATURES = np.geomspace(0.5, 8.0, 33)
DOUBTS = np.array([0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2])
"""The grid that is searched."""
FEWEST_EXAMPLES = 20
"""With fewer evaluated examples a fit is partly chance; the fewer, the nearer the result is to CAUTIOUS."""


@dataclass(frozen=True, slots=True)
class PosteriorCalibration:
    """p' = (1 - doubt) p^(1/temperature)/Z + doubt/M; as it is by default."""

    temperature: float = 1.0
    doubt: float = 0.0

    def apply(self, posterior: Floats) -> Floats:
        """(A,) or (A, K) posterior that sums to 1 over all entries -> the calibrated posterior, same shape."""
        if self == PosteriorCalibration():
            return posterior
        cells = posterior.ravel()
        with np.errstate(divide="ignore"):
            tempered = softmax(np.log(cells) / self.temperature)
        return ((1 - self.doubt) * tempered + self.doubt / len(cells)).reshape(posterior.shape)


CAUTIOUS = PosteriorCalibration(temperature=1.3, doubt=0.12)
"""For a model that could hardly be evaluated, or only on its own person: what fits for other people and models of 3 to
20 movements learned from one training subject each, of 1, 3, 5, 7, 9 of MSR Action3D (docs/guide/own-movements.md)."""


def calibrated_posterior(watch: "Watch", calibration: PosteriorCalibration) -> tuple[Floats, float | None]:
    """(M, K) calibrated posterior given that it is one of the movements, and P(none of them), None if unknown."""
    joint, unlearned = watch.joint, watch.unlearned
    learned = calibration.apply(watch.p[:, None] if joint is None else joint)
    # The sum over the facings may be above 1 by rounding.
    return learned, None if unlearned is None else min(float(unlearned.sum()), 1.0)


@dataclass(frozen=True, slots=True)
class HeldOutResult:
    """The result for an example by a model that had not learned from its person; posteriors: (T, M) at T times.

    truth: index of the right answer.
    """

    truth: int
    posteriors: Floats


def fit_calibration(results: Sequence[HeldOutResult]) -> PosteriorCalibration:
    """The calibration of least log loss; of few results the geometric mean of it and of one that is also CAUTIOUS."""
    if not results:
        return CAUTIOUS
    logs = np.log(np.maximum(np.concatenate([r.posteriors for r in results]), 1e-300))
    truth = np.repeat([r.truth for r in results], [len(r.posteriors) for r in results])
    best = (np.inf, 1.0, 0.0)
    for temperature in TEMPERATURES:
        right = softmax(logs / temperature)[np.arange(len(truth)), truth]
        # A model without an error in n examples may be wrong in the next.
        for doubt in DOUBTS[min(1.0 / len(truth), CAUTIOUS.doubt) <= DOUBTS]:
            loss = -float(np.log((1 - doubt) * right + doubt / logs.shape[1]).mean())
            best = min(best, (loss, float(temperature), float(doubt)))
    fitted = PosteriorCalibration(*best[1:])
    cautious, share = at_least_cautious(fitted), min(len(results) / FEWEST_EXAMPLES, 1.0)
    return PosteriorCalibration(
        cautious.temperature ** (1 - share) * fitted.temperature**share,
        cautious.doubt ** (1 - share) * fitted.doubt**share,
    )


def at_least_cautious(calibration: PosteriorCalibration) -> PosteriorCalibration:
    """The calibration, at least as cautious as CAUTIOUS: for a single person's model."""
    return PosteriorCalibration(
        max(calibration.temperature, CAUTIOUS.temperature), max(calibration.doubt, CAUTIOUS.doubt)
    )
