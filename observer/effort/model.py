"""Effort as Bayesian variables: P(E_q) P(F | E_q), each factor with its own posterior (science: Rett 2009). Pure.

Each labelled trial is an example, as in the model `phase`; a pole is the mixture of its examples:

    P(F | E_q = e) = mean over trials n with level e of t_ν(F; F_n, S_q)

    t_ν(F; m, S) proportional to (1 + (F-m)' S^-1 (F-m) / ν)^-(ν+d)/2          Student's t in d features
    S_q = W + k B     W: how trials of the same Effort differ between actions, B: how actions differ, shrunk

The factors colour each other (a free and sudden movement is not the sum of both), which a mixture of examples keeps and
one Gaussian a pole loses. B makes what depends on the action count little: actions that nobody showed are judged too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.facets import EFFORT
from observer.effort.features import LEAN, NAMES, OTHER_HAND, RISE, TEMPO, WANDER
from observer.tracks import Floats

FACTORS = ("space", "weight", "time", "flow")
"""The order of the levels of a trial; the facet is called effort_ and this."""
EVIDENCE: Mapping[str, tuple[str, ...]] = {
    "space": (*LEAN, *OTHER_HAND, *WANDER),
    "weight": RISE,
    "time": TEMPO,
    "flow": (*LEAN, *OTHER_HAND, *WANDER),
}
"""Which features speak of which factor."""
NU = 3.0
"""Degrees of freedom of Student's t: one odd feature does not decide."""
SHRINK = 0.3
"""How much of the covariances between features is not believed: there are fewer trials than they have entries."""
UNKNOWN_ACTION = 2.0
"""k: how far an action that nobody showed may be from those that were, in variances between those."""
RIDGE = 0.01
"""Variance that every feature has beside, in its own variances: two trials are never the same."""
ROUNDING = 1e-12
"""No example is impossible."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One labelled movement. features: (D,) those of NAMES. levels: -1, 0 or 1 for each of FACTORS."""

    features: Floats
    levels: tuple[int, int, int, int]
    action: str


@dataclass(frozen=True, slots=True, eq=False)
class EffortModel:
    """Examples (N, D) with levels (N, 4), and for each factor the spread S_q (d, d) of its evidence and a temperature.

    Features are in the examples' own means and deviations, (D,) each. temper: (4,) what log odds are multiplied with.
    """

    view: str
    rate_hz: float
    body_parts: tuple[str, ...]
    mean: Floats
    deviation: Floats
    examples: Floats
    levels: NDArray[np.int64]
    spreads: Mapping[str, Floats]
    temper: Floats
    provenance: Mapping[str, str] = field(default_factory=dict)
    _kept: dict[tuple[str, bytes], "Witnesses"] = field(default_factory=dict, init=False, repr=False)

    def posterior(self, features: Floats) -> dict[str, Floats]:
        """(D,) -> for each facet effort_* the probabilities (2,) of its poles; halves where nothing is seen."""
        z = (features - self.mean) / self.deviation
        found = {}
        for q, factor in enumerate(FACTORS):
            odds = self.temper[q] * log_odds(self, z, factor)
            found[f"effort_{factor}"] = np.array([1.0, np.exp(-odds)])[::-1] / (1.0 + np.exp(-odds))
        return {facet: found[facet] for facet in EFFORT}

    def witnesses(self, factor: str, seen: NDArray[np.bool_]) -> "Witnesses":
        """The examples as far as their features are `seen`: what is missing is left out, as in any marginal."""
        key = (factor, seen.tobytes())
        if key not in self._kept:
            q, columns = FACTORS.index(factor), COLUMNS[factor][seen]
            poles = [np.flatnonzero(self.levels[:, q] == level) for level in (-1, 1)]
            inverse = np.linalg.inv(self.spreads[factor][np.ix_(seen, seen)])
            both = np.concatenate(poles)
            self._kept[key] = Witnesses(self.examples[np.ix_(both, columns)], len(poles[0]), np.asarray(inverse))
        return self._kept[key]


@dataclass(frozen=True, slots=True, eq=False)
class Witnesses:
    """Examples (K, d) of both poles of one factor, those of -1 first, and the inverse of their spread."""

    examples: Floats
    low: int
    inverse: Floats


COLUMNS: Mapping[str, NDArray[np.int64]] = {
    factor: np.array([NAMES.index(name) for name in names]) for factor, names in EVIDENCE.items()
}


def log_odds(model: EffortModel, z: Floats, factor: str) -> float:
    """ln P(F | +1) - ln P(F | -1) of one factor before its temperature; z (D,) standardised, NaN where not seen.

    0 when nothing is seen, or when the trials show one pole only.
    """
    evidence = z[COLUMNS[factor]]
    seen = np.isfinite(evidence)
    among = model.witnesses(factor, seen)
    if not seen.any() or among.low in (0, len(among.examples)):
        return 0.0
    apart = evidence[seen] - among.examples
    squares = ((apart @ among.inverse) * apart).sum(axis=1)
    logs = -0.5 * (NU + len(evidence[seen])) * np.log1p(squares / NU)
    mass = np.exp(logs - logs.max()) + ROUNDING
    return float(np.log(mass[among.low :].mean()) - np.log(mass[: among.low].mean()))


def spread(z: Floats, levels: NDArray[np.int64], actions: Sequence[str]) -> Floats:
    """(N, d) standardised features -> S_q (d, d): between trials of the same levels, and k times between actions."""
    own = z.copy()
    names = sorted(set(actions))
    centres = np.array([z[[a == name for a in actions]].mean(axis=0) for name in names])
    for name, centre in zip(names, centres, strict=True):
        own[[a == name for a in actions]] -= centre
    between = np.cov(centres.T).reshape(z.shape[1], -1) if len(names) > 1 else np.zeros((z.shape[1],) * 2)
    whole = _among_alike(own, levels) + UNKNOWN_ACTION * between
    return (1 - SHRINK) * whole + SHRINK * np.diag(np.diag(whole)) + RIDGE * np.eye(z.shape[1])


def _among_alike(z: Floats, levels: NDArray[np.int64]) -> Floats:
    """How trials of the same four levels differ; without any such pair, how all of them do."""
    groups: dict[bytes, list[int]] = {}
    for n, row in enumerate(levels):
        groups.setdefault(row.tobytes(), []).append(n)
    several = [g for g in groups.values() if len(g) > 1] or [list(range(len(z)))]
    parts = [(z[g] - z[g].mean(axis=0)) * np.sqrt(len(g) / (len(g) - 1 or 1)) for g in several]
    left = np.concatenate(parts)
    return np.asarray(left.T @ left / len(left))
