"""`labanmesh evaluate --effort`: Effort in one action by models of the others, for each view and fused."""

import json as json_text
from collections import Counter
from collections.abc import Mapping, Sequence
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
from observer.effort.model import FACTORS, EffortExample, EffortModel, effort_examples, learn_trials
from observer.geometry.views import View, parse_view, split_views
from observer.motion.archive import MotionArchive, common_rate, select
from observer.motion.archive_file import read_archive
from observer.tracks import Floats
from studies.fusion_engine import DEFAULT_RULE, get_rule
from studies.metrics import accuracy, expected_calibration_error, log_loss
from studies.output_files import require_writable, write_text
from studies.report import FRACTIONS, figures, prepare_report
from studies.settings import Progress, check_names

FUSED = "fused"


def effort(
    archive: Annotated[Path, typer.Argument(help="The motion archive (.npz); trials such as -1_0_1_1.")],
    views: Annotated[
        str, typer.Option(help="door, wheel, table, yaw:DEG[,pitch:DEG] or camera files, separated by commas.")
    ],
    report: Annotated[Path | None, typer.Option(help="Folder for the tables and the figure.")] = None,
    json: Annotated[Path | None, typer.Option(help="File for the figures as JSON.")] = None,
    of_effort: Annotated[bool, typer.Option("--effort", show_default=False, help="Effort, not movements.")] = True,
) -> None:
    """Judge the poles of Space, Weight, Time and Flow in each action by models of the other actions.

    Example: labanmesh evaluate --effort effort.npz --views door,wheel --report out
    """
    whole = read_archive(archive)
    usual = Counter(r.rate_hz for r in whole.recordings).most_common(1)[0][0]
    chosen = [parse_view(text) for text in split_views(views)]
    if report is not None:
        prepare_report(report)
    if json is not None:
        require_writable(json, "--json")
    with ProgressBar() as bar:
        at = judge_poles(select(whole, (), usual), chosen, FRACTIONS, bar)
    summary = as_json(at)
    text = as_text(summary)
    print(text)
    written = [] if report is None else _write_report(report, text, at[1.0], summary)
    if json is not None:
        written.append(write_text(json, json_text.dumps(summary, indent=1) + "\n", "--json"))
    if written:
        print("\nwritten:", *written, sep="\n  ")


def _write_report(folder: Path, text: str, result: "EffortResult", summary: dict[str, Any]) -> list[Path]:
    series, ece = {}, {}
    for factor, by in summary["factors"].items():
        p, truth = result.poles(FUSED, factor)
        series[factor], ece[factor] = (p.max(axis=1), p.argmax(axis=1) == truth), by[FUSED]["ece"]
    return [
        write_text(folder / "effort.txt", text + "\n", "--report"),
        figures().reliability_figure(series, ece, folder / "reliability.png"),
    ]


@dataclass(frozen=True, slots=True, eq=False)
class EffortResult:
    """p: (N, V + 1, 4, 2) by trial, view (fused last), factor and pole; levels: (N, 4); actions: N names."""

    views: tuple[str, ...]
    p: Floats
    levels: NDArray[np.int64]
    actions: tuple[str, ...]

    def poles(self, view: str, factor: str, action: str = "") -> tuple[Floats, NDArray[np.int64]]:
        """(K, 2) posteriors of the trials at a pole of the factor, and (K,) which pole: 0 for -1, 1 for +1."""
        q = FACTORS.index(factor)
        chosen = (self.levels[:, q] != 0) & np.array([action in ("", own) for own in self.actions])
        p: Floats = self.p[chosen, [*self.views, FUSED].index(view), q]
        return p, (self.levels[chosen, q] + 1) // 2

    def neutral(self, view: str, factor: str) -> Floats:
        """(K, 2) posteriors of the trials at neither pole."""
        q = FACTORS.index(factor)
        p: Floats = self.p[self.levels[:, q] == 0, [*self.views, FUSED].index(view), q]
        return p


def judge_poles(
    archive: MotionArchive,
    views: Sequence[View],
    fractions: Sequence[float] = (1.0,),
    progress: Progress = lambda *_: None,
) -> dict[float, EffortResult]:
    """Judge each action by models of the others, after each fraction of the movement.

    Raises BadInput for an archive without Effort levels or with a single action.
    """
    pool, rate_hz = get_rule(DEFAULT_RULE).pool, common_rate(archive)
    names = tuple(view.name for view in views)
    check_names(names)
    whole = {view.name: effort_examples(archive, view) for view in views}
    first = whole[names[0]]
    models = _models(whole, rate_hz)
    results = {}
    for done, fraction in enumerate(fractions, 1):
        p: Floats = np.empty((len(first), len(views) + 1, len(FACTORS), 2))
        for v, view in enumerate(views):
            for n, trial in enumerate(effort_examples(archive, view, fraction)):
                p[n, v] = _poles(models[view.name, trial.action], trial)
        for n, q in np.ndindex(len(first), len(FACTORS)):
            p[n, -1, q] = pool(p[n, :-1, q], uniform(2)).p
        levels, actions = np.array([trial.levels for trial in first]), tuple(trial.action for trial in first)
        results[fraction] = EffortResult(names, p, levels, actions)
        progress("judging", done, len(fractions))
    return results


def _models(whole: Mapping[str, Sequence[EffortExample]], rate_hz: float) -> dict[tuple[str, str], EffortModel]:
    """For each view and action the model learned from the other actions."""
    actions = sorted({trial.action for trials in whole.values() for trial in trials})
    if len(actions) < 2:
        raise BadInput(f"Effort: 1 action only, {actions[0]!r}; models of one action are judged on another")
    return {
        (view, action): learn_trials([t for t in trials if t.action != action], view, rate_hz)
        for view, trials in whole.items()
        for action in actions
    }


def _poles(model: EffortModel, trial: EffortExample) -> Floats:
    """(4, 2) in the order of FACTORS."""
    facets = model.posterior(trial.features)
    return np.array([facets[f"effort_{factor}"] for factor in FACTORS])


def as_json(at: Mapping[float, EffortResult]) -> dict[str, Any]:
    """By factor and view: accuracy, calibration, accuracy by action; and the fused accuracy after each fraction."""
    result = at[max(at)]
    names = [*result.views, FUSED]
    return {
        "views": list(result.views),
        "rule": DEFAULT_RULE,
        "actions": sorted(set(result.actions)),
        "trials": len(result.actions),
        "factors": {f: {name: _figures(result, name, f) for name in names} for f in FACTORS},
        "fused_at": {f: {f"{part:g}": accuracy(*r.poles(FUSED, f)) for part, r in at.items()} for f in FACTORS},
    }


def _figures(result: EffortResult, view: str, factor: str) -> dict[str, Any]:
    p, truth = result.poles(view, factor)
    neutral = result.neutral(view, factor)
    return {
        "n": len(truth),
        "accuracy": accuracy(p, truth),
        "by_action": {a: accuracy(*result.poles(view, factor, a)) for a in sorted(set(result.actions))},
        "confidence": float(p.max(axis=1).mean()),
        "ece": expected_calibration_error(p, truth),
        "log_loss": log_loss(p, truth),
        "neutral_p_high": float(neutral[:, 1].mean()) if len(neutral) else None,
        "neutral_confidence": float(neutral.max(axis=1).mean()) if len(neutral) else None,
    }


def as_text(summary: dict[str, Any]) -> str:
    """The figures as tables for people."""
    names = [*summary["views"], FUSED]
    head = f"{'accuracy of the poles':<34}" + "".join(f"{name:>9}" for name in names)
    head += f"{'n':>5}{'sure':>7}{'ECE':>7}{'neutral':>9}"
    lines = [f"each of {', '.join(summary['actions'])} judged by models of the others, {summary['rule']}", "", head]
    lines.append("-" * len(head))
    for factor, by in summary["factors"].items():
        low, high = EFFORT[f"effort_{factor}"]
        fused = by[FUSED]
        cells = "".join(f"{by[name]['accuracy']:>9.3f}" for name in names)
        neutral = fused["neutral_confidence"]
        cells += f"{fused['n']:>5}{fused['confidence']:>7.2f}{fused['ece']:>7.3f}"
        lines.append(f"{f'{factor}: {low}, {high}':<34}{cells}{'-' if neutral is None else f'{neutral:.2f}':>9}")
    lines += ["", f"{'fused, by action':<34}" + "".join(f"{action:>10}" for action in summary["actions"])]
    for factor, by in summary["factors"].items():
        lines.append(f"{factor:<34}" + "".join(f"{rate:>10.3f}" for rate in by[FUSED]["by_action"].values()))
    fractions = next(iter(summary["fused_at"].values()))
    if len(fractions) > 1:
        lines += ["", f"{'fused, after this share':<34}" + "".join(f"{float(part):>9.0%}" for part in fractions)]
        for factor, rates in summary["fused_at"].items():
            lines.append(f"{factor:<34}" + "".join(f"{rate:>9.3f}" for rate in rates.values()))
    return "\n".join(lines)
