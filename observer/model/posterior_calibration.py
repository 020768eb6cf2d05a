"""How far a model's beliefs can be believed: the temperature and the doubt that make a probability of 0.8 right 8 times
in 10, and how unlike the learned movements something has to be to be none of them. Pure; docs/design/model.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from common.probability import Floats, softmax

if TYPE_CHECKING:
    from observer.model.base import Watch

Indices = NDArray[np.int64]

TEMPERATURES = np.geomspace(0.5, 8.0, 33)
DOUBTS = np.array([0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2])
LEAST_SPREAD = 0.3
"""Of the mean spread: few examples of a movement can be alike by chance."""
FEWEST_EXAMPLES = 20
"""Judged examples below which what is fitted is chance: nothing is believed more than by FEW then."""
LEAST_P = 1e-12
HINT = 0.5
"""Nats that one judge may say for or against something else: how well a movement is foreseen depends on the tracker
too. That the judges disagree says more, and only fusion sees it.
"""


@dataclass(frozen=True, slots=True)
class PosteriorCalibration:
    """p' = (1 - doubt) p^(1/temperature)/Z + doubt/M, and P(something else) from how well the movement was foreseen.

    foreseen: per movement mean and spread of how well its examples were foreseen (mean log probability a frame) by a
    model that had not learned from the same person; empty where that is not known. unlike, slope: ln of the odds that
    something is none of the movements, slope (z - unlike), z spreads below the mean, against the movement's own. Of a
    model that knows something else these are left out: that is one more of its answers, and p' is over all of them.
    """

    temperature: float = 1.0
    doubt: float = 0.0
    foreseen: tuple[tuple[float, float], ...] = ()
    unlike: float = 0.0
    slope: float = 0.0

    def of(self, belief: Floats) -> Floats:
        """(A,) or (A, K) posterior over answers, summing to 1 over all -> the same, to be believed."""
        if self.temperature == 1.0 and self.doubt == 0.0:
            return belief
        cells = belief.ravel()
        with np.errstate(divide="ignore"):
            tempered = softmax(np.log(cells) / self.temperature)
        believed: Floats = ((1 - self.doubt) * tempered + self.doubt / len(cells)).reshape(belief.shape)
        return believed

    def unlearned(self, p: Floats, foreseen: Floats | None) -> float | None:
        """p (M,), foreseen (M,) mean log probability a frame -> P(none of the movements); prior 1/(M+1).

        None where nothing was learned of it, or the person has not moved.
        """
        if foreseen is None or not self.foreseen:
            return None
        m = int(p.argmax())
        mean, spread = self.foreseen[m]
        log_odds = self.slope * ((mean - float(foreseen[m])) / spread - self.unlike)
        return float(1.0 / (1.0 + len(p) * np.exp(-np.clip(log_odds, -HINT, HINT))))


FEW = PosteriorCalibration(temperature=1.3, doubt=0.12)
"""What is believed of a model that could hardly be tried, or on its own person alone: what other people make of models
of 3 to 20 movements learned from one training subject each, of 1, 3, 5, 7, 9 of MSR Action3D
(docs/guide/own-movements.md).
"""


@dataclass(frozen=True, slots=True)
class Tried:
    """One example, judged by a model that had not learned from its person. beliefs: (T, M) at some times of it.

    foreseen: (M,) how well each movement foresaw it to its end, None where the model cannot tell. Of a model that knows
    something else that is the last of its answers M + 1; truth M is an example of it, by whose like it did not learn.
    """

    truth: int
    beliefs: Floats
    foreseen: Floats | None


def fit(tried: Sequence[Tried], movements: int) -> PosteriorCalibration:
    """Temperature and doubt of the least log loss; mean and spread of what is foreseen, the odds by logistic fit."""
    if not tried:
        return FEW
    beliefs = np.concatenate([t.beliefs for t in tried])
    truth = np.concatenate([np.full(len(t.beliefs), t.truth) for t in tried])
    temperature, doubt = _least_log_loss(beliefs, truth, _weights(truth, movements))
    if len(tried) < FEWEST_EXAMPLES:
        return not_surer(PosteriorCalibration(temperature, doubt))
    if beliefs.shape[1] > movements or any(t.foreseen is None for t in tried):
        return PosteriorCalibration(temperature, doubt)
    stats = _foreseen(tried, movements)
    own = np.array([_below(t, t.truth, stats) for t in tried])
    other = np.array([_below(t, _best_other(t), stats) for t in tried])
    slope, unlike = _logistic(own, other)
    return PosteriorCalibration(temperature, doubt, stats, unlike, slope)


def not_surer(found: PosteriorCalibration) -> PosteriorCalibration:
    """The same, but no surer than FEW, and silent about what is none of the movements: found of one person alone."""
    return PosteriorCalibration(max(found.temperature, FEW.temperature), max(found.doubt, FEW.doubt))


def _weights(truth: Indices, movements: int) -> Floats:
    """Of each example: those of something else together as much as those of a movement, as its prior 1/(M+1) says."""
    strange = truth == movements
    share = (~strange).sum() / (movements * max(int(strange.sum()), 1))
    return np.where(strange, share, 1.0)


def _least_log_loss(beliefs: Floats, truth: Indices, weights: Floats) -> tuple[float, float]:
    with np.errstate(divide="ignore"):
        logs = np.log(np.maximum(beliefs, 1e-300))
    best = (np.inf, 1.0, 0.0)
    for temperature in TEMPERATURES:
        right = softmax(logs / temperature)[np.arange(len(truth)), truth]
        # Who was never wrong in n trials may be in the next.
        for doubt in DOUBTS[min(1.0 / float(weights.sum()), FEW.doubt) <= DOUBTS]:
            losses = -np.log((1 - doubt) * right + doubt / beliefs.shape[1] + LEAST_P)
            loss = float((weights * losses).mean())
            best = min(best, (loss, float(temperature), float(doubt)))
    return best[1], best[2]


def _foreseen(tried: Sequence[Tried], movements: int) -> tuple[tuple[float, float], ...]:
    own: list[list[float]] = [[] for _ in range(movements)]
    for t in tried:
        if t.foreseen is not None:
            own[t.truth].append(float(t.foreseen[t.truth]))
    everything = np.array([value for values in own for value in values])
    spreads = np.array([np.std(values) for values in own if len(values) > 1] or [everything.std()])
    least = max(LEAST_SPREAD * float(spreads.mean()), 1e-6)
    return tuple(
        (float(np.mean(values)), max(float(np.std(values)), least))
        if len(values) > 1
        else (float(everything.mean()), float(everything.std()) + least)
        for values in own
    )


def _below(tried: Tried, movement: int, stats: Sequence[tuple[float, float]]) -> float:
    """Spreads by which it was foreseen worse than examples of that movement are."""
    mean, spread = stats[movement]
    return 0.0 if tried.foreseen is None else (mean - float(tried.foreseen[movement])) / spread


def _best_other(tried: Tried) -> int:
    """What the model would have taken it for, had it not learned the right movement."""
    others = tried.beliefs[-1].copy()
    others[tried.truth] = -1.0
    return int(others.argmax())


def _logistic(own: Floats, other: Floats) -> tuple[float, float]:
    """Slope and place where both are equally likely: Newton's method, with a ridge against separable data."""
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


def answers_of(watch: "Watch") -> Floats:
    """(A, K) posterior over answers and facings: the M movements and, if it is known, "something else" as the last."""
    joint, unlearned = watch.joint, watch.unlearned
    learned = watch.p[:, None] if joint is None else joint
    return learned if unlearned is None else np.vstack([learned * (1.0 - unlearned.sum()), unlearned])


def given_learned(answers: Floats) -> Floats:
    """(M + 1, K) -> (M, K) given that it is one of the movements; uniform where that cannot be."""
    learned = answers[:-1]
    total = float(learned.sum())
    return learned / total if total > 0 else np.full(learned.shape, 1.0 / learned.size)


def believed(watch: "Watch", certainty: PosteriorCalibration) -> tuple[Floats, float | None]:
    """(M, K) what can be believed of its movements, given that it is one, and P(none of them), None if not known."""
    answers = certainty.of(answers_of(watch))
    if watch.unlearned is not None:
        return given_learned(answers), float(answers[-1].sum())
    return answers, certainty.unlearned(answers.sum(axis=1), watch.foreseen)
