"""`labanmesh effort`: learn Effort from all actions but one, judge the poles in that one, by view and fused. Pure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.facets import EFFORT
from common.probability import uniform
from fusion.engine.rules import DEFAULT_RULE, get_rule
from observer.effort.learning import learn_trials, trials_in
from observer.effort.model import FACTORS, EffortModel, Trial
from observer.geometry.views import View
from observer.learning import common_rate
from observer.motion.archive import MotionArchive
from studies.metrics import accuracy, expected_calibration_error, log_loss

Floats = NDArray[np.float64]
FUSED = "fused"
FRACTIONS = (0.2, 0.4, 0.6, 0.8, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """p: (N, V + 1, 4, 2) by trial, view (fused last), factor and pole; levels: (N, 4); actions: N names."""

    views: tuple[str, ...]
    p: Floats
    levels: NDArray[np.int64]
    actions: tuple[str, ...]

    def poles(self, view: str, factor: str, action: str = "") -> tuple[Floats, NDArray[np.int64]]:
        """(K, 2) what was believed of the trials at a pole of the factor, and (K,) which: 0 for -1, 1 for +1."""
        q = FACTORS.index(factor)
        chosen = (self.levels[:, q] != 0) & np.array([action in ("", own) for own in self.actions])
        p: Floats = self.p[chosen, [*self.views, FUSED].index(view), q]
        return p, (self.levels[chosen, q] + 1) // 2

    def neutral(self, view: str, factor: str) -> Floats:
        """(K, 2) what was believed of the trials that are at neither pole."""
        q = FACTORS.index(factor)
        p: Floats = self.p[self.levels[:, q] == 0, [*self.views, FUSED].index(view), q]
        return p


def judge_poles(
    archive: MotionArchive,
    views: Sequence[View],
    rule: str = DEFAULT_RULE,
    fractions: Sequence[float] = (1.0,),
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> dict[float, Judged]:
    """Each action judged by models that have learned from the others, when each fraction of a movement has been seen.

    Raises BadInput for an archive without Effort levels or with one action only, and for a rule that is not there.
    """
    pool, rate_hz = get_rule(rule, len(views)).pool, common_rate(archive)
    names = tuple(view.name for view in views)
    if len(set(names)) < len(names):
        raise BadInput(f"--views: {', '.join(names)}: every view needs a name of its own")
    whole = {view.name: trials_in(archive, view) for view in views}
    first = whole[names[0]]
    actions = tuple(trial.action for trial in first)
    judges = _judges(whole, rate_hz)
    judged = {}
    for done, fraction in enumerate(fractions, 1):
        p: Floats = np.empty((len(first), len(views) + 1, len(FACTORS), 2))
        for v, view in enumerate(views):
            for n, trial in enumerate(trials_in(archive, view, fraction)):
                p[n, v] = _poles(judges[view.name, trial.action], trial)
        for n, q in np.ndindex(len(first), len(FACTORS)):
            p[n, -1, q] = pool(p[n, :-1, q], uniform(2)).p
        judged[fraction] = Judged(names, p, np.array([trial.levels for trial in first]), actions)
        progress("judging", done, len(fractions))
    return judged


def _judges(whole: Mapping[str, Sequence[Trial]], rate_hz: float) -> dict[tuple[str, str], EffortModel]:
    """For each view and action the model that has learned from the other actions."""
    actions = sorted({trial.action for trials in whole.values() for trial in trials})
    if len(actions) < 2:
        raise BadInput(f"Effort: one action only, {actions[0]!r}; what it teaches is judged by another one")
    return {
        (view, action): learn_trials([t for t in trials if t.action != action], view, rate_hz)
        for view, trials in whole.items()
        for action in actions
    }


def _poles(model: EffortModel, trial: Trial) -> Floats:
    """(4, 2) in the order of FACTORS."""
    facets = model.posterior(trial.features)
    return np.array([facets[f"effort_{factor}"] for factor in FACTORS])


def as_json(at: Mapping[float, Judged], rule: str) -> dict[str, Any]:
    """The figures: for each factor and view accuracy, calibration, by action; fused, when a fraction has been seen."""
    judged = at[max(at)]
    names = [*judged.views, FUSED]
    return {
        "views": list(judged.views),
        "rule": rule,
        "actions": sorted(set(judged.actions)),
        "trials": len(judged.actions),
        "factors": {f: {name: _figures(judged, name, f) for name in names} for f in FACTORS},
        "fused_at": {f: {f"{part:g}": accuracy(*j.poles(FUSED, f)) for part, j in at.items()} for f in FACTORS},
    }


def _figures(judged: Judged, view: str, factor: str) -> dict[str, Any]:
    p, truth = judged.poles(view, factor)
    neutral = judged.neutral(view, factor)
    return {
        "n": len(truth),
        "accuracy": accuracy(p, truth),
        "by_action": {a: accuracy(*judged.poles(view, factor, a)) for a in sorted(set(judged.actions))},
        "confidence": float(p.max(axis=1).mean()),
        "ece": expected_calibration_error(p, truth),
        "log_loss": log_loss(p, truth),
        "neutral_p_high": float(neutral[:, 1].mean()) if len(neutral) else None,
        "neutral_confidence": float(neutral.max(axis=1).mean()) if len(neutral) else None,
    }


def as_text(found: dict[str, Any]) -> str:
    """The figures as a table."""
    names = [*found["views"], FUSED]
    head = f"{'poles told apart':<34}" + "".join(f"{name:>9}" for name in names)
    head += f"{'n':>5}{'sure':>7}{'ECE':>7}{'neutral':>9}"
    lines = [f"each of {', '.join(found['actions'])} judged by what the others taught, {found['rule']}", "", head]
    lines.append("-" * len(head))
    for factor, by in found["factors"].items():
        low, high = EFFORT[f"effort_{factor}"]
        fused = by[FUSED]
        cells = "".join(f"{by[name]['accuracy']:>9.3f}" for name in names)
        neutral = fused["neutral_confidence"]
        cells += f"{fused['n']:>5}{fused['confidence']:>7.2f}{fused['ece']:>7.3f}"
        lines.append(f"{f'{factor}: {low}, {high}':<34}{cells}{'-' if neutral is None else f'{neutral:.2f}':>9}")
    lines += ["", f"{'fused, by action':<34}" + "".join(f"{action:>10}" for action in found["actions"])]
    for factor, by in found["factors"].items():
        lines.append(f"{factor:<34}" + "".join(f"{rate:>10.3f}" for rate in by[FUSED]["by_action"].values()))
    seen = next(iter(found["fused_at"].values()))
    if len(seen) > 1:
        lines += ["", f"{'fused, of the movement seen':<34}" + "".join(f"{float(part):>9.0%}" for part in seen)]
        for factor, rates in found["fused_at"].items():
            lines.append(f"{factor:<34}" + "".join(f"{rate:>9.3f}" for rate in rates.values()))
    return "\n".join(lines)
