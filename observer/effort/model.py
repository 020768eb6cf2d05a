"""Effort as Bayesian variables, P(E_q) P(F | E_q), learned from labelled recordings (docs/design/effort.md). Pure.

Each labelled trial is an example; a pole is the mean of Student's t over its examples, with the spread S_q = W + k B: W
is how trials of the same Effort differ between actions, B how actions differ.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.facets import EFFORT
from observer.effort.features import FEATURE_NAMES, LEAN, OTHER_HAND, RISE, TEMPO, WANDER, course_of, features
from observer.geometry.views import View
from observer.motion.archive import MotionArchive, common_rate, movements_in
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS, Floats

FACTORS = ("space", "weight", "time", "flow")
"""In the order of the levels of a trial; the facet is named effort_ and the factor."""
FACTOR_FEATURES: Mapping[str, tuple[str, ...]] = {
    "space": (*LEAN, *OTHER_HAND, *WANDER),
    "weight": RISE,
    "time": TEMPO,
    "flow": (*LEAN, *OTHER_HAND, *WANDER),
}
"""The features that are evidence of each factor."""
NU = 3.0
"""Degrees of freedom of Student's t, so that one outlier does not decide."""
SHRINKAGE = 0.3
"""Shrinkage of the covariances between features: there are fewer trials than covariances."""
UNKNOWN_ACTION = 2.0
"""k: distance of an unknown action from the known ones, in variances between these."""
RIDGE = 0.01
"""Additional variance of every feature, in its own variances: two trials are never the same."""
ROUNDING = 1e-12
"""Added to each likelihood, so that no example is impossible."""


@dataclass(frozen=True, slots=True)
class EffortExample:
    """One labelled movement. features: (D,) those of FEATURE_NAMES. levels: -1, 0 or 1 for each of FACTORS."""

    features: Floats
    levels: tuple[int, int, int, int]
    action: str


@dataclass(frozen=True, slots=True, eq=False)
class EffortModel:
    """Examples (N, D) with levels (N, 4), and for each factor the spread S_q (d, d) of its evidence and a temperature.

    Features are standardised by the examples' means and deviations, (D,) each. temper: (4,) factors of the log odds.
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
    _cache: dict[tuple[str, bytes], "PoleExamples"] = field(default_factory=dict, init=False, repr=False)

    def posterior(self, features: Floats) -> dict[str, Floats]:
        """(D,) -> for each facet effort_* the probabilities (2,) of its poles; equal if no feature is known."""
        z = (features - self.mean) / self.deviation
        posteriors = {}
        for q, factor in enumerate(FACTORS):
            odds = self.temper[q] * log_odds(self, z, factor)
            posteriors[f"effort_{factor}"] = np.array([1.0, np.exp(-odds)])[::-1] / (1.0 + np.exp(-odds))
        return {facet: posteriors[facet] for facet in EFFORT}

    def pole_examples(self, factor: str, known: NDArray[np.bool_]) -> "PoleExamples":
        """The examples' `known` features of a factor: missing ones are marginalised."""
        key = (factor, known.tobytes())
        if key not in self._cache:
            q, columns = FACTORS.index(factor), FACTOR_COLUMNS[factor][known]
            poles = [np.flatnonzero(self.levels[:, q] == level) for level in (-1, 1)]
            inverse = np.linalg.inv(self.spreads[factor][np.ix_(known, known)])
            both = np.concatenate(poles)
            self._cache[key] = PoleExamples(self.examples[np.ix_(both, columns)], len(poles[0]), np.asarray(inverse))
        return self._cache[key]


@dataclass(frozen=True, slots=True, eq=False)
class PoleExamples:
    """Examples (K, d) of both poles of one factor, the `low` ones of -1 first, and the inverse of their spread."""

    examples: Floats
    low: int
    inverse: Floats


FACTOR_COLUMNS: Mapping[str, NDArray[np.int64]] = {
    factor: np.array([FEATURE_NAMES.index(name) for name in names]) for factor, names in FACTOR_FEATURES.items()
}


def log_odds(model: EffortModel, z: Floats, factor: str) -> float:
    """ln P(F | +1) - ln P(F | -1) of one factor before its temperature; z (D,) standardised, NaN if unknown.

    0 if no feature is known, or if the trials show one pole only.
    """
    evidence = z[FACTOR_COLUMNS[factor]]
    known = np.isfinite(evidence)
    among = model.pole_examples(factor, known)
    if not known.any() or among.low in (0, len(among.examples)):
        return 0.0
    difference = evidence[known] - among.examples
    squares = ((difference @ among.inverse) * difference).sum(axis=1)
    logs = -0.5 * (NU + len(evidence[known])) * np.log1p(squares / NU)
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
    return (1 - SHRINKAGE) * whole + SHRINKAGE * np.diag(np.diag(whole)) + RIDGE * np.eye(z.shape[1])


def _among_alike(z: Floats, levels: NDArray[np.int64]) -> Floats:
    """Covariance of trials of the same four levels; without any such pair, of all trials."""
    groups: dict[bytes, list[int]] = {}
    for n, row in enumerate(levels):
        groups.setdefault(row.tobytes(), []).append(n)
    several = [g for g in groups.values() if len(g) > 1] or [list(range(len(z)))]
    parts = [(z[g] - z[g].mean(axis=0)) * np.sqrt(len(g) / (len(g) - 1 or 1)) for g in several]
    left = np.concatenate(parts)
    return np.asarray(left.T @ left / len(left))


TRIAL_LEVELS = re.compile(r"(-?[01])_(-?[01])_(-?[01])_(-?[01])(?:\..*)?")
"""Name of a labelled trial: levels of Space, Weight, Time, Flow; anything after a dot."""
TEMPERS = np.geomspace(0.02, 2.0, 60)
"""Candidate temperatures; a few trials without an error would otherwise make it infinite."""


def levels_of(trial: str) -> tuple[int, int, int, int] | None:
    """`-1_0_1_1` or `-1_0_1_1.2` -> (-1, 0, 1, 1): Space, Weight, Time, Flow; None for other names."""
    match = TRIAL_LEVELS.fullmatch(trial)
    if not match:
        return None
    space, weight, time, flow = (int(level) for level in match.groups())
    return space, weight, time, flow


def effort_examples(archive: MotionArchive, view: View, fraction: float = 1.0) -> list[EffortExample]:
    """The labelled recordings as the view sees them, or the first `fraction` of each; their label is the action.

    Raises BadInput if none is labelled, for recordings at different rates, and if hands or head are missing.
    """
    common_rate(archive)
    labelled = [(r, levels) for r in movements_in(archive) if (levels := levels_of(r.trial)) is not None]
    if not labelled:
        raise BadInput(
            "Effort: no recording's trial names its levels; -1_0_1_1 (Space, Weight, Time, Flow) is expected"
        )
    trials = []
    for recording, levels in labelled:
        tracks = [t.centres for t in view_tracks(view, recording, archive.body_parts, BODY_PARTS)]
        course = course_of(tracks[: math.ceil(fraction * len(tracks))], BODY_PARTS, recording.rate_hz)
        trials.append(EffortExample(features(course), levels, recording.label))
    return trials


def learn_effort(archive: MotionArchive, view: View, provenance: Mapping[str, str] | None = None) -> EffortModel:
    """One view's Effort model from all labelled recordings of the archive; raises BadInput as `effort_examples`."""
    trials = effort_examples(archive, view)
    origin = {"examples": str(len(trials)), **(provenance or {})}
    return replace(learn_trials(trials, view.name, common_rate(archive)), provenance=origin)


def learn_trials(trials: Sequence[EffortExample], view: str, rate_hz: float) -> EffortModel:
    """The model of these trials; temperatures are fitted by leaving out one action at a time (or one trial of one)."""
    model = _untempered(trials, view, rate_hz)
    return replace(model, temper=np.array([_temper(model, trials, factor) for factor in FACTORS]))


def _untempered(trials: Sequence[EffortExample], view: str, rate_hz: float) -> EffortModel:
    table = np.array([trial.features for trial in trials])
    known = np.isfinite(table)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, table, 0.0).sum(axis=0) / count
    # A missing feature becomes the mean of the other examples, which is weak evidence.
    filled = np.where(known, table, mean)
    deviation = filled.std(axis=0) + 1e-9
    z = (filled - mean) / deviation
    levels = np.array([trial.levels for trial in trials], dtype=np.int64)
    actions = [trial.action for trial in trials]
    spreads = {factor: spread(z[:, FACTOR_COLUMNS[factor]], levels, actions) for factor in FACTORS}
    return EffortModel(view, rate_hz, BODY_PARTS, mean, deviation, z, levels, spreads, np.ones(len(FACTORS)))


def _temper(model: EffortModel, trials: Sequence[EffortExample], factor: str) -> float:
    """The temperature of least log loss, each action evaluated with the examples of the others."""
    actions = [trial.action for trial in trials]
    groups = actions if len(set(actions)) > 1 else [str(n) for n in range(len(trials))]
    q = FACTORS.index(factor)
    odds: list[float] = []
    for group in sorted(set(groups)):
        others = [n for n, g in enumerate(groups) if g != group]
        unaware = replace(model, examples=model.examples[others], levels=model.levels[others])
        odds += [
            log_odds(unaware, model.examples[n], factor) * model.levels[n, q]
            for n, g in enumerate(groups)
            if g == group and model.levels[n, q] != 0
        ]
    losses = [np.logaddexp(0.0, -temper * np.array(odds)).mean() for temper in TEMPERS]
    return float(TEMPERS[int(np.argmin(losses))]) if odds else 1.0
