"""Weighs what the members of a model say at one instant: one conditional stacker for one take and for a thousand. Pure.

    score(m)          = Σ_k w_k f_k(m)              w_k = Σ_q B_kq c_q             f: (J, M), c: (Q,)
    score(else)       = ln Σ_m e^score(m) + Σ_g v_g h_g        v_g = Σ_r D_gr e_r  h: (G,), e: (R,)
    P                 = softmax(score) over the M movements and something else

f: MEMBERS, c: CONTEXT, h: EVIDENCE and e: OTHER_CONTEXT, which docs/design/model.md explains. Wolpert, "Stacked
generalization", Neural Networks 5, 1992; the weights depend on the instant as in Sill, Takacs, Mackey and Lin,
"Feature-weighted linear stacking", 2009. B and D have Gaussian priors, whose means depend on how much was learned
(TASK) and are themselves learned over many tasks (`stacker_prior.py`). A user's takes move them as far as they are
evidence.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.probability import SMALLEST, softmax
from observer.tracks import Floats, Integers

MEMBERS = ("phase", "trailing", "running", "ended", "nearest")
OTHER_CONTEXT = ("one", "over", "elapsed", "unknown")
CONTEXT = (*OTHER_CONTEXT, *(f"entropy of {member}" for member in MEMBERS if member != "nearest"))
EVIDENCE = ("one", "odds", "distance", "agreement", "entropy", "smallness")
ENDED, BEGIN_UNKNOWN = MEMBERS.index("ended"), CONTEXT.index("unknown")
TASK = ("one", "takes", "people", "movements", "other motion")
"""1; the logarithms of the numbers of takes of a movement, of people and of movements, and of 1 + the seconds of other
motion, from which the members have learned."""

LOWEST = float(np.log(1e-4))
"""Floor of a member's log posterior: no member can veto a movement alone."""
MOST_ODDS = 8.0
"""Largest log odds of the trailing windows, either way: more than that a regression on few takes does not know."""
FARTHEST = 6.0
"""Larger relative distances count as this, and so does a movement that cannot be compared with its takes yet."""
UNLIKE = 2.0
"""Relative distance from which a movement is as unlike its takes as can be: a tracker noisier than that of the takes
alone makes it larger. The cross-entropy of something else over the prior's tasks is .524; .528 with 1.5."""


@dataclass(frozen=True, slots=True, eq=False)
class Instants:
    """What the members say, with any leading shape. A member that does not judge has zeros.

    members (..., J, M), context (..., Q); odds and agreement (...): see EVIDENCE. by_movement (..., 2, M): logarithms
    of the relative distance from the nearest take, 0 where unknown, and of the extent as a share of the usual one.
    """

    members: Floats
    context: Floats
    odds: Floats
    agreement: Floats
    by_movement: Floats

    @property
    def other_context(self) -> Floats:
        """(..., R)"""
        return self.context[..., : len(OTHER_CONTEXT)]

    @classmethod
    def of(cls, instants: Sequence["Instants"]) -> Self:
        """All in one, along a new first axis."""
        return cls(*(np.array([getattr(one, name) for one in instants]) for name in _FIELDS))

    def at(self, rows: Integers | NDArray[np.bool_]) -> "Instants":
        """Those of these rows."""
        return Instants(*(getattr(self, name)[rows] for name in _FIELDS))

    def without(self, movements: Integers) -> "Instants":
        """(N, ...) instants as members would judge them that do not know `movements` (N,), which is something else."""
        rows = np.arange(len(movements))
        members = self.members.copy()
        judging = members[:, :4].any(axis=-1)
        known = np.logaddexp.reduce(members[:, :4], axis=-1)
        members[rows, :4, movements] = LOWEST
        left = np.logaddexp.reduce(members[:, :4], axis=-1)
        members[:, :4] -= left[..., None]
        members[rows, :4, movements] = LOWEST
        members[:, :4][~judging] = 0.0
        members[rows, 4, movements] = np.where(members[:, 4].any(axis=-1), -FARTHEST, 0.0)
        context = self.context.copy()
        context[:, 4:] = np.where(judging, _entropy(members[:, :4]), 0.0)
        # What the trailing windows give to the other movements remains.
        odds = np.clip(self.odds + (known - left)[:, 1], -MOST_ODDS, MOST_ODDS)
        return Instants(members, context, odds, agreement_of(members), self.by_movement)


_FIELDS = ("members", "context", "odds", "agreement", "by_movement")


def instant_of(
    phase: Floats | None,
    log_trailing: Floats,
    log_segment: Floats | None,
    distances: Floats | None,
    extents: Floats,
    over: bool,
    elapsed: float,
) -> Instants:
    """One instant. phase (M,): posterior; log_trailing (M + 1,), something else last; log_segment (2, M): running,
    ended; distances (M,): relative, inf where unknown; extents (M,): shares of the usual; elapsed: in lengths.

    None: the begin of the movement is not known, so that the member does not judge.
    """
    # Once for each instant of a stream, so in few and plain operations.
    movements = len(log_trailing) - 1
    members, by_movement = np.zeros((len(MEMBERS), movements)), np.zeros((2, movements))
    learned = np.logaddexp.reduce(log_trailing[:-1])
    np.subtract(log_trailing[:-1], learned, out=members[1])
    if phase is not None:
        np.log(np.maximum(phase, 1e-300), out=members[0])
    known_begin = log_segment is not None
    if log_segment is not None:
        np.subtract(log_segment, np.logaddexp.reduce(log_segment, axis=1, keepdims=True), out=members[2:4])
    np.maximum(members, LOWEST, out=members)
    if distances is not None and np.isfinite(distances).any():
        members[4] = -np.minimum(distances, FARTHEST)
        far = np.minimum(np.maximum(distances, 1 / FARTHEST), UNLIKE)
        np.log(far, out=by_movement[0], where=np.isfinite(distances))
    np.log(np.minimum(np.maximum(extents, 0.05), 1.0), out=by_movement[1])
    context = np.empty(len(CONTEXT))
    context[:4] = 1.0, over, math.log(min(max(elapsed, 0.1), 3.0)) if known_begin else 0.0, not known_begin
    # That of a member that does not judge is 0.
    context[4:] = _entropy(members[:4])
    odds = min(max(float(log_trailing[-1] - learned), -MOST_ODDS), MOST_ODDS)
    return Instants(members, context, np.float64(odds), agreement_of(members), by_movement)  # type: ignore[arg-type]


def _entropy(logs: Floats) -> Floats:
    """(..., M) log probabilities -> (...) entropy as a share of ln M."""
    p = np.exp(logs)
    entropy: Floats = (p * logs).sum(axis=-1) / -max(math.log(logs.shape[-1]), 1.0)
    return entropy


def agreement_of(members: Floats) -> Floats:
    """(..., J, M) -> (...) ln of the probability that draws by the phase filter and by the regressions agree.

    0 where the phase filter does not judge.
    """
    regressions = members[..., 1:4, :].sum(axis=-2) / 3
    regressions -= np.logaddexp.reduce(regressions, axis=-1, keepdims=True)
    judging = members[..., 0, :].any(axis=-1)
    agreement: Floats = np.where(judging, np.logaddexp.reduce(members[..., 0, :] + regressions, axis=-1), 0.0)
    return agreement


@dataclass(frozen=True, slots=True, eq=False)
class Stacker:
    """weights (J, Q): B. other (G, R): D."""

    weights: Floats
    other: Floats

    def judge(self, instants: Instants) -> tuple[Floats, Floats]:
        """(..., M) P(movement | it is one of them), and (...) P(something else)."""
        weights = instants.context @ self.weights.T
        p = softmax((weights[..., None, :] @ instants.members)[..., 0, :])
        odds = (instants.other_context @ self.other.T * evidence(instants, p)).sum(axis=-1)
        return p, 1 / (1 + np.exp(np.minimum(np.maximum(-odds, -30.0), 30.0)))

    def judge_ended(self, instants: Instants, course: Floats) -> tuple[Floats, Floats]:
        """The same of recordings that have ended. course (..., M): the sum of `shown_by` their judgements so far.

        Where the begin is known, the course counts as much as the end, at which people may already do what comes after.
        The member for ended movements counts once more there: the models of fewer people, by which the weights are
        learned, are right less often (docs/results/notebook.md).
        """
        p, something_else = self.judge(instants)
        known, share = 1 - instants.context[..., BEGIN_UNKNOWN, None], 1 / len(MEMBERS)
        logs = np.log(np.maximum(p, SMALLEST))
        end = (1 - share) * logs + share * instants.members[..., ENDED, :]
        both = (end + np.log(np.maximum(course, SMALLEST))) / 2
        return softmax(known * both + (1 - known) * logs), something_else


def shown_by(p: Floats, something_else: Floats) -> Floats:
    """(..., M), (...) as `Stacker.judge` gives them -> (..., M) p times P(a movement) times 1 - the entropy of p."""
    surely: Floats = (1 - something_else) * (1 - _entropy(np.log(np.maximum(p, SMALLEST))))
    return surely[..., None] * p


def evidence(instants: Instants, p: Floats) -> Floats:
    """(..., M) P(movement) -> (..., G) h."""
    result = np.ones((*p.shape[:-1], len(EVIDENCE)))
    result[..., 1], result[..., 3] = instants.odds, instants.agreement
    result[..., 2::3] = (instants.by_movement @ p[..., None])[..., 0]
    result[..., 4] = (p * np.log(np.maximum(p, 1e-12))).sum(axis=-1) / -max(math.log(p.shape[-1]), 1.0)
    return result


def task_of(takes: float, people: float, movements: int, other_s: float) -> Floats:
    """(Z,) TASK. takes: mean number of takes of a movement; people: effective number; other_s: seconds of motion."""
    return np.log([np.e, max(takes, 1.0), max(people, 1), max(movements, 2), 1.0 + other_s])


@dataclass(frozen=True, slots=True, eq=False)
class Gaussians:
    """Independent Gaussians for the entries of a matrix; means (Z, A, B), spreads (A, B): standard deviations."""

    means: Floats
    spreads: Floats

    def at(self, task: Floats) -> Floats:
        """(A, B) means for a task (Z,)."""
        mean: Floats = np.tensordot(task, self.means, axes=1)
        return mean


@dataclass(frozen=True, slots=True, eq=False)
class StackerPrior:
    """What is known about the weights before anything was tried."""

    weights: Gaussians
    other: Gaussians

    def stacker(self, task: Floats) -> Stacker:
        """The stacker of a model that could not be tried."""
        return Stacker(self.weights.at(task), self.other.at(task))


@dataclass(frozen=True, slots=True, eq=False)
class StackerRows:
    """N instants of material from which the members have not learned.

    truth (N,): the movement, -1 for something else. shown (N,): how far it shows already, 0 to 1. weights (N,): those
    of one recording sum to about 1, because its instants are not independent. teaches_label (N,): whether B is learned
    from it.
    """

    instants: Instants
    truth: Integers
    shown: Floats
    weights: Floats
    teaches_label: NDArray[np.bool_]


def fit(prior: StackerPrior, task: Floats, rows: StackerRows | None) -> Stacker:
    """The stacker of greatest posterior probability: that of the prior without rows."""
    start = prior.stacker(task)
    if rows is None or not len(rows.truth):
        return start
    weights, other = start.weights, start.other
    if (chosen := rows.teaches_label).any():
        loss = LabelLoss(rows.instants.at(chosen), rows.truth[chosen], rows.weights[chosen])
        weights = most_probable(loss, start.weights, prior.weights.spreads)
    p, _ = Stacker(weights, other).judge(rows.instants)
    target = np.where(rows.truth >= 0, 1.0 - rows.shown, 1.0)
    return Stacker(weights, most_probable(ElseLoss(rows.instants, p, target, rows.weights), other, prior.other.spreads))


class LabelLoss:
    """(J, Q) weights -> weighted cross-entropy of the movements in nats, and its gradient."""

    def __init__(self, instants: Instants, truth: Integers, weights: Floats) -> None:
        # (N, JQ, M): the score is linear in the weights.
        x = instants.context[:, None, :, None] * instants.members[:, :, None, :]
        self.x = x.reshape(len(truth), -1, x.shape[-1])
        self._at, self._truth, self.weights = np.arange(len(truth)), truth, weights

    def __call__(self, w: Floats) -> tuple[float, Floats]:
        """(J, Q) -> the loss in nats, (J Q,) its gradient."""
        scores = np.einsum("a,nam->nm", w.ravel(), self.x, optimize=True)
        logs = scores - np.logaddexp.reduce(scores, axis=1, keepdims=True)
        loss = -float(self.weights @ logs[self._at, self._truth])
        residual = np.exp(logs)
        residual[self._at, self._truth] -= 1.0
        gradient: Floats = np.einsum("nm,nam->a", residual * self.weights[:, None], self.x, optimize=True)
        return loss, gradient


class ElseLoss:
    """(G, R) weights -> weighted cross-entropy of something else in nats, and its gradient. target: (N,) 0 to 1."""

    def __init__(self, instants: Instants, p: Floats, target: Floats, weights: Floats) -> None:
        self.x = (evidence(instants, p)[:, :, None] * instants.other_context[:, None, :]).reshape(len(target), -1)
        self._target, self.weights = target, weights

    def __call__(self, w: Floats) -> tuple[float, Floats]:
        """(G, R) -> the loss in nats, (G R,) its gradient."""
        odds = self.x @ w.ravel()
        loss = float(self.weights @ (np.logaddexp(0.0, odds) - self._target * odds))
        gradient = self.x.T @ (self.weights * (1 / (1 + np.exp(-np.clip(odds, -30, 30))) - self._target))
        return loss, gradient


def most_probable(loss: "LabelLoss | ElseLoss", mean: Floats, spreads: Floats) -> Floats:
    """The mode of exp(-loss) times the Gaussian prior; deviations are in spreads, so that all are alike."""
    from scipy.optimize import minimize

    def negative_log(z: Floats) -> tuple[float, Floats]:
        value, gradient = loss(mean + z.reshape(mean.shape) * spreads)
        return value + 0.5 * float(z @ z), gradient * spreads.ravel() + z

    best: Floats = minimize(negative_log, np.zeros(mean.size), jac=True, method="L-BFGS-B").x
    return mean + best.reshape(mean.shape) * spreads
