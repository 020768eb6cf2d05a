"""`labanmesh effort`: learns Effort from all actions but one and judges the poles in that one."""

import json as json_text
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from common.errors import BadInput
from common.facets import EFFORT
from common.probability import uniform
from common.progress import ProgressBar
from fusion.engine.rules import DEFAULT_RULE, get_rule
from observer.effort.learning import learn_trials, trials_in
from observer.effort.model import FACTORS, EffortModel, Trial
from observer.geometry.views import View
from observer.motion.archive import MotionArchive
from observer.motion.transforms import common_rate
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


def effort(
    archive: Annotated[Path, typer.Argument(help="The motion archive (.npz); trials such as -1_0_1_1.")],
    views: Annotated[str, typer.Option(help="door, wheel, table, yaw:DEG[,pitch:DEG], camera files; by commas.")],
    rule: Annotated[str, typer.Option(help="Name of the fusion rule.")] = "robust_inverse_entropy",
    rate: Annotated[float | None, typer.Option(min=1, help="Frames a second; what most recordings have.")] = None,
    report: Annotated[Path | None, typer.Option(help="Folder for the tables and figures.")] = None,
    json: Annotated[Path | None, typer.Option(help="File for the figures as JSON.")] = None,
) -> None:
    """Poles of Space, Weight, Time and Flow told apart, each action judged by what the other actions taught.

    Example: labanmesh effort effort.npz --views door,wheel --report out
    """
    from observer.geometry.views import parse_view, split_views
    from observer.motion.archive_file import read_archive
    from observer.motion.transforms import select
    from studies.effort import FRACTIONS, as_json, as_text, judge_poles

    whole = read_archive(archive)
    usual = Counter(r.rate_hz for r in whole.recordings).most_common(1)[0][0]
    whole = select(whole, (), rate or usual)
    seen = [parse_view(text) for text in split_views(views)]
    with ProgressBar() as bar:
        at = judge_poles(whole, seen, rule, FRACTIONS, bar)
    found = as_json(at, rule)
    text = as_text(found)
    print(text)
    written = [] if report is None else _report(report, text, at[1.0], found)
    if json is not None:
        _write(json, json_text.dumps(found, indent=1) + "\n", "--json")
        written.append(json)
    if written:
        print("\nwritten:", *written, sep="\n  ")


def _report(folder: Path, text: str, judged: "Judged", found: dict[str, Any]) -> list[Path]:
    from studies.report import figures

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"--report {folder}: {error.strerror}") from None
    _write(folder / "effort.txt", text + "\n", "--report")
    return [folder / "effort.txt", *(_drawn(figures(), judged, found, folder))]


def _drawn(figures: Any, judged: "Judged", found: dict[str, Any], folder: Path) -> list[Path]:  # noqa: ANN401 - a module
    from studies.effort import FUSED

    names = [*judged.views, FUSED]
    rates = {name: [by[name]["accuracy"] for by in found["factors"].values()] for name in names}
    series, ece = {}, {}
    for factor, by in found["factors"].items():
        p, truth = judged.poles(FUSED, factor)
        series[factor], ece[factor] = (p.max(axis=1), p.argmax(axis=1) == truth), by[FUSED]["ece"]
    return [
        figures.poles_figure(list(found["factors"]), rates, folder / "poles.png"),
        figures.reliability_figure(series, ece, folder / "reliability.png"),
    ]


def _write(path: Path, text: str, option: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{option} {path}: {error.strerror}") from None
