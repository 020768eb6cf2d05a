"""Calibrates a model's posteriors: temperature and uniform mixing so that a probability of 0.8 is right 8 times in 10.

Also decides how unlike the learned movements a movement must be to count as none of them. Pure; docs/design/model.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from common.probability import Floats, softmax
from observer.tracks import Integers

if TYPE_CHECKING:
    from observer.model.base import Watch

TEMPERATURES = np.geomspace(0.5, 8.0, 33)
DOUBTS = np.array([0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2])
SMALLEST_SPREAD = 0.3
"""As a share of the mean spread: a few examples of a movement can be alike by chance."""
FEWEST_EXAMPLES = 20
"""With fewer evaluated examples a fit is partly chance; the fewer, the nearer the result is to CAUTIOUS."""
TINY_P = 1e-12
MAX_EVIDENCE = 0.5
"""Nats for or against "something else" from one observer: the likelihood of a movement also depends on the tracker.
Disagreement between observers says more, and only fusion sees that."""


@dataclass(frozen=True, slots=True)
class PosteriorCalibration:
    """p' = (1 - doubt) p^(1/temperature)/Z + doubt/M, and P(something else) from the predictive likelihood.

    likelihood_statistics: for each movement mean and standard deviation of `Watch.predictive_log_likelihood` over its
    examples, by models that had not learned from the same person; empty if unknown. unlike, slope: the log odds that a
    movement is none of the vocabulary are slope (z - unlike), where z is the number of standard deviations by which its
    likelihood lies below the mean. A model with the answer "something else" needs none of these; p' then covers all
    M + 1 answers. learned_only: the model has learned by itself how sure it may be, and its posterior is used as it is.
    """

    temperature: float = 1.0
    doubt: float = 0.0
    likelihood_statistics: tuple[tuple[float, float], ...] = ()
    unlike: float = 0.0
    slope: float = 0.0
    learned_only: bool = False

    def apply(self, posterior: Floats) -> Floats:
        """(A,) or (A, K) posterior that sums to 1 over all entries -> the calibrated posterior, same shape."""
        if self.temperature == 1.0 and self.doubt == 0.0:
            return posterior
        cells = posterior.ravel()
        with np.errstate(divide="ignore"):
            tempered = softmax(np.log(cells) / self.temperature)
        calibrated: Floats = ((1 - self.doubt) * tempered + self.doubt / len(cells)).reshape(posterior.shape)
        return calibrated

    def unlearned(self, p: Floats, log_likelihood: Floats | None) -> float | None:
        """P(none of the movements), with the prior 1/(M+1), from p (M,) and `Watch.predictive_log_likelihood` (M,).

        None if the calibration knows nothing about it, or if the person has not moved yet.
        """
        if log_likelihood is None or not self.likelihood_statistics:
            return None
        m = int(p.argmax())
        mean, spread = self.likelihood_statistics[m]
        log_odds = self.slope * ((mean - float(log_likelihood[m])) / spread - self.unlike)
        return float(1.0 / (1.0 + len(p) * np.exp(-np.clip(log_odds, -MAX_EVIDENCE, MAX_EVIDENCE))))


CAUTIOUS = PosteriorCalibration(temperature=1.3, doubt=0.12)
"""For a model that could hardly be evaluated, or only on its own person: what fits for other people and models of 3 to
20 movements learned from one training subject each, of 1, 3, 5, 7, 9 of MSR Action3D (docs/guide/own-movements.md)."""


def answer_posterior(watch: "Watch") -> Floats:
    """(A, K) posterior over answers and facings: the M movements and, if the model knows it, "something else" last."""
    return _answers(_learned(watch), watch.unlearned)


def _learned(watch: "Watch") -> Floats:
    joint = watch.joint
    return watch.p[:, None] if joint is None else joint


def _answers(learned: Floats, unlearned: Floats | None) -> Floats:
    return learned if unlearned is None else np.vstack([learned * (1.0 - _probability(unlearned)), unlearned])


def _probability(over_facings: Floats) -> float:
    """The sum over the facings; rounding may bring it above 1, and one less it below 0, whose logarithm is NaN."""
    return min(float(over_facings.sum()), 1.0)


def given_learned(answers: Floats) -> Floats:
    """(M + 1, K) -> (M, K) given that it is one of the movements; uniform if that is impossible."""
    learned = answers[:-1]
    total = float(learned.sum())
    return learned / total if total > 0 else np.full(learned.shape, 1.0 / learned.size)


def calibrated_posterior(watch: "Watch", calibration: PosteriorCalibration) -> tuple[Floats, float | None]:
    """(M, K) calibrated posterior given that it is one of the movements, and P(none of them), None if unknown."""
    learned, unlearned = _learned(watch), watch.unlearned
    if calibration.learned_only and unlearned is not None:
        return learned, _probability(unlearned)
    answers = calibration.apply(_answers(learned, unlearned))
    if unlearned is not None:
        return given_learned(answers), _probability(answers[-1])
    return answers, calibration.unlearned(answers.sum(axis=1), watch.predictive_log_likelihood)


@dataclass(frozen=True, slots=True)
class HeldOutResult:
    """The result for an example by a model that had not learned from its person; posteriors: (T, A) at T times.

    truth: index of the right answer. log_likelihood: (M,) `Watch.predictive_log_likelihood` at the end, None if the
    model computes none. A model that knows "something else" has A = M + 1 answers, of which this is the last, otherwise
    A = M; truth M is an example of a background movement that the model had not learned.
    """

    truth: int
    posteriors: Floats
    log_likelihood: Floats | None


def fit_calibration(results: Sequence[HeldOutResult], movements: int) -> PosteriorCalibration:
    """The calibration of least log loss, and for "something else" the odds by logistic regression."""
    if not results:
        return CAUTIOUS
    posteriors = np.concatenate([r.posteriors for r in results])
    truth = np.concatenate([np.full(len(r.posteriors), r.truth) for r in results])
    temperature, doubt = _least_log_loss(posteriors, truth, _weights(truth, movements))
    if len(results) < FEWEST_EXAMPLES:
        return _nearly_cautious(temperature, doubt, len(results) / FEWEST_EXAMPLES)
    if posteriors.shape[1] > movements or any(r.log_likelihood is None for r in results):
        return PosteriorCalibration(temperature, doubt)
    statistics = _likelihood_statistics(results, movements)
    own = np.array([_spreads_below(r, r.truth, statistics) for r in results])
    other = np.array([_spreads_below(r, _best_other(r), statistics) for r in results])
    slope, unlike = _logistic(own, other)
    return PosteriorCalibration(temperature, doubt, statistics, unlike, slope)


def _nearly_cautious(temperature: float, doubt: float, share: float) -> PosteriorCalibration:
    """The geometric mean of a fit, with this share, and of one that is at least as cautious as CAUTIOUS."""
    cautious = at_least_cautious(PosteriorCalibration(temperature, doubt))
    return PosteriorCalibration(
        cautious.temperature ** (1 - share) * temperature**share, cautious.doubt ** (1 - share) * doubt**share
    )


def at_least_cautious(calibration: PosteriorCalibration) -> PosteriorCalibration:
    """The calibration, at least as cautious as CAUTIOUS and without "something else": for a single person's model."""
    return PosteriorCalibration(
        max(calibration.temperature, CAUTIOUS.temperature), max(calibration.doubt, CAUTIOUS.doubt)
    )


def _weights(truth: Integers, movements: int) -> Floats:
    """All examples of "something else" together weigh as much as those of one movement, as its prior 1/(M+1) says."""
    background = truth == movements
    share = (~background).sum() / (movements * max(int(background.sum()), 1))
    return np.where(background, share, 1.0)


def _least_log_loss(posteriors: Floats, truth: Integers, weights: Floats) -> tuple[float, float]:
    with np.errstate(divide="ignore"):
        logs = np.log(np.maximum(posteriors, 1e-300))
    best = (np.inf, 1.0, 0.0)
    for temperature in TEMPERATURES:
        right = softmax(logs / temperature)[np.arange(len(truth)), truth]
        # A model without an error in n examples may be wrong in the next.
        for doubt in DOUBTS[min(1.0 / float(weights.sum()), CAUTIOUS.doubt) <= DOUBTS]:
            losses = -np.log((1 - doubt) * right + doubt / posteriors.shape[1] + TINY_P)
            loss = float((weights * losses).mean())
            best = min(best, (loss, float(temperature), float(doubt)))
    return best[1], best[2]


def _likelihood_statistics(results: Sequence[HeldOutResult], movements: int) -> tuple[tuple[float, float], ...]:
    own: list[list[float]] = [[] for _ in range(movements)]
    for r in results:
        if r.log_likelihood is not None:
            own[r.truth].append(float(r.log_likelihood[r.truth]))
    everything = np.array([value for values in own for value in values])
    spreads = np.array([np.std(values) for values in own if len(values) > 1] or [everything.std()])
    smallest = max(SMALLEST_SPREAD * float(spreads.mean()), 1e-6)
    return tuple(
        (float(np.mean(values)), max(float(np.std(values)), smallest))
        if len(values) > 1
        else (float(everything.mean()), float(everything.std()) + smallest)
        for values in own
    )


def _spreads_below(result: HeldOutResult, movement: int, statistics: Sequence[tuple[float, float]]) -> float:
    """By how many spreads the likelihood lies below that movement's mean."""
    mean, spread = statistics[movement]
    return 0.0 if result.log_likelihood is None else (mean - float(result.log_likelihood[movement])) / spread


def _best_other(result: HeldOutResult) -> int:
    """The answer that the model would have given without the right movement."""
    others = result.posteriors[-1].copy()
    others[result.truth] = -1.0
    return int(others.argmax())


def _logistic(own: Floats, other: Floats) -> tuple[float, float]:
    """Slope and the point of equal odds, by Newton's method; a ridge bounds the slope for separable data."""
    x = np.clip(np.concatenate([own, other]), -10.0, 10.0)
    y = np.concatenate([np.zeros(len(own)), np.ones(len(other))])
    design, weights = np.stack([x, np.ones(len(x))], axis=1), np.zeros(2)
    for _ in range(50):
        p = 1.0 / (1.0 + np.exp(-design @ weights))
        gradient = design.T @ (y - p) - 0.1 * weights
        hessian = (design * (p * (1 - p))[:, None]).T @ design + 0.1 * np.eye(2)
        weights = weights + np.linalg.solve(hessian, gradient)
    slope = max(float(weights[0]), 1e-6)
    return slope, float(-weights[1] / slope)
