"""Runs an evaluation as the command asks for it: with progress, text on stdout, and files."""

import json as json_text
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.errors import BadInput
from common.parallel import cores
from common.progress import ProgressBar
from observer.motion.archive import MotionArchive
from studies.evaluate import EvaluationSettings, require_fits, results_of
from studies.learning_curve import as_table, learning_curve
from studies.observing import Extent, observe_folds
from studies.output_files import require_writable, write_text
from studies.report import as_json, draw_learning_curve, draw_streams, prepare_report, write_report
from studies.report_text import as_text, resolved_pairs
from studies.stream import judge_observed


@dataclass(frozen=True, slots=True)
class EvaluationTasks:
    """What to do with the settings. jobs: 0 is all cores; report: a folder; json: a file."""

    stream: bool = False
    curve: bool = False
    jobs: int = 1
    report: Path | None = None
    json: Path | None = None


def require_compatible(settings: EvaluationSettings, tasks: EvaluationTasks) -> None:
    """Raise BadInput for options that exclude each other."""
    needs_positions: Mapping[str, bool] = {
        "--turn": settings.turn != 0,
        "--facings": settings.parameters.get("facings", 1) > 1,
    }
    for option, is_set in needs_positions.items():
        if is_set and any(view.is_this_camera for view in settings.views):
            raise BadInput(f"{option}: needs positions in 3-D, and the archive holds 2-D tracks; omit it")
    unfit: Mapping[str, bool] = {
        "--learning-curve": tasks.curve,
        "--turn": settings.turn != 0,
        "--onset unknown": not settings.onset_known,
    }
    for option, is_set in unfit.items():
        if settings.sensors and is_set:
            raise BadInput(f"--sensor {option}: sensors are judged on what they recorded; omit {option}")
    if tasks.curve and settings.background:
        raise BadInput("--learning-curve: takes no movements in --background-labels; use blends or omit it")


def run_evaluation(archive: MotionArchive, settings: EvaluationSettings, tasks: EvaluationTasks) -> list[Path]:
    """Evaluate with progress, print the result, write the requested files; returns the files.

    Each model is learned once, and judges all that is asked for.
    """
    report, jobs, streams = tasks.report, tasks.jobs or cores(), tasks.stream or bool(settings.other_motion)
    if report:
        prepare_report(report)
    if tasks.json:
        require_writable(tasks.json, "--json")
    require_fits(settings)
    with ProgressBar() as bar:
        # First, so that its bad input is reported at once.
        curve = learning_curve(archive, settings, bar) if tasks.curve else None
        folds = observe_folds(archive, settings, Extent(streams=streams), bar, jobs)
        judged = judge_observed(folds, settings, bar, jobs) if streams else None
        result = results_of(folds, settings)
    figures = as_json(result)
    if judged:
        figures["stream"] = judged.as_json()
    if curve:
        figures["learning_curve"] = curve
    _print(figures)
    written: list[Path] = []
    if report:
        written = write_report(result, figures, report)
        written += draw_streams(judged, report) if judged else []
        written += [draw_learning_curve(curve, report / "learning-curve.png")] if curve else []
    if tasks.json:
        written.append(write_text(tasks.json, json_text.dumps(figures, indent=1) + "\n", "--json"))
    return written


def _print(figures: dict[str, Any]) -> None:
    print(as_text(figures))
    if "learning_curve" in figures:
        print(f"\n{as_table(figures['learning_curve'])}")
    if len(figures["views"]) > 1:
        print(f"\n{resolved_pairs(figures)}")
