"""Runs an evaluation as the command asks for it: with progress, text on stdout, and files."""

import json as json_text
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.errors import BadInput
from common.parallel import cores
from common.progress import ProgressBar
from observer.motion.archive import MotionArchive, select
from studies.evaluate import EvaluationResult, EvaluationSettings, require_fits, results_of
from studies.learning_curve import as_table, learning_curve
from studies.observing import Extent, observe_folds
from studies.output_files import require_writable, write_text
from studies.over_mesh import fused_over_mesh
from studies.report import (
    as_json,
    draw_learning_curve,
    draw_streams,
    prepare_report,
    write_report,
)
from studies.report_text import as_text, resolved_pairs
from studies.spotting import StreamResult
from studies.stream import judge_observed


@dataclass(frozen=True, slots=True)
class EvaluationTasks:
    """What to do with the settings: options of the command that are no settings of an evaluation. jobs: 0 is all cores.

    scenery: of pictures, for through = "pixels".
    """

    through: str = "process"
    scenery: str = "plain"
    stream: bool = False
    curve: bool = False
    jobs: int = 1


@dataclass(frozen=True, slots=True)
class _Outcome:
    """All results; raw: before calibration; judged: the streams."""

    result: EvaluationResult
    figures: dict[str, Any]
    raw: EvaluationResult | None = None
    judged: StreamResult | None = None


def require_compatible(settings: EvaluationSettings, tasks: EvaluationTasks) -> None:
    """Raise BadInput for options that exclude each other."""
    pixels_or_turn: Mapping[str, bool] = {
        "--through pixels": tasks.through == "pixels",
        "--turn": settings.turn != 0,
        "--facings": settings.parameters.get("facings", 1) > 1,
        "--room": bool(settings.room),
    }
    for option, is_set in pixels_or_turn.items():
        if is_set and any(view.is_this_camera for view in settings.views):
            raise BadInput(f"{option}: needs positions in 3-D, and the archive holds 2-D tracks; omit it")
    unfit: Mapping[str, bool] = {
        "--through": tasks.through != "process",
        "--learning-curve": tasks.curve,
        "--turn": settings.turn != 0,
        "--room": bool(settings.room),
        "--onset unknown": not settings.onset_known,
    }
    for option, is_set in unfit.items():
        if settings.sensors and is_set:
            raise BadInput(f"--sensor {option}: sensors are judged on what they recorded; omit {option}")
    if tasks.curve and settings.background:
        raise BadInput("--learning-curve: takes no movements in --background-labels; use blends or omit it")
    if tasks.through == "pixels" and (settings.background_archive or settings.other_motion):
        raise BadInput("--through pixels: takes plain, cluttered or skin_toned as --background, and no --other-motion")


def run_evaluation(
    archive: MotionArchive, settings: EvaluationSettings, tasks: EvaluationTasks, report: Path | None, json: Path | None
) -> list[Path]:
    """Evaluate with progress, print the result, write the requested files; returns the files."""
    if report:
        prepare_report(report)
    if json:
        require_writable(json, "--json")
    require_fits(settings)
    with ProgressBar() as bar:
        # First, so that its bad input is reported at once.
        curves = {"learning_curve": learning_curve(archive, settings, bar)} if tasks.curve else {}
        # Reliability is drawn before and after calibration.
        needs_raw = report is not None and settings.calibrated
        by = _from_pixels if tasks.through == "pixels" else _from_joints
        outcome = by(archive, settings, tasks, needs_raw, bar)
    figures = outcome.figures | curves
    _print(figures)
    written = write_report(outcome.result, figures, report, outcome.raw) if report else []
    if report and outcome.judged:
        written += draw_streams(outcome.judged, report)
    if report and tasks.curve:
        written.append(draw_learning_curve(figures["learning_curve"], report / "learning-curve.png"))
    if json:
        written.append(write_text(json, json_text.dumps(figures, indent=1) + "\n", "--json"))
    return written


def _from_joints(
    archive: MotionArchive, settings: EvaluationSettings, tasks: EvaluationTasks, needs_raw: bool, bar: ProgressBar
) -> _Outcome:
    """Each model is learned once, and judges all that is asked for."""
    jobs, streams = tasks.jobs or cores(), tasks.stream or bool(settings.other_motion)
    folds = observe_folds(archive, settings, Extent(streams=streams, raw=needs_raw), bar, jobs)
    judged = judge_observed(folds, settings, bar, jobs) if streams else None
    result = results_of(folds, settings)
    figures = as_json(result)
    if judged:
        figures["stream"] = judged.as_json()
    if tasks.through == "mesh":
        figures["mesh"] = fused_over_mesh(result, bar)
    return _Outcome(result, figures, results_of(folds, settings, raw=True) if needs_raw else None, judged)


def _from_pixels(
    archive: MotionArchive, settings: EvaluationSettings, tasks: EvaluationTasks, needs_raw: bool, bar: ProgressBar
) -> _Outcome:
    """From pictures at a camera's rate, and for comparison from the joints."""
    # Imported on use: positions need no OpenCV.
    from observer.rendering.scenery import Scenery
    from studies.from_pixels import PICTURE_RATE_HZ, Filming, evaluate_pixels

    sampled = select(archive, rate_hz=PICTURE_RATE_HZ)
    result = evaluate_pixels(sampled, settings, Filming(Scenery(background=tasks.scenery)), bar)
    joints = _from_joints(sampled, settings, tasks, needs_raw, bar)
    figures = as_json(result) | {"background": tasks.scenery, "joints": as_json(joints.result)}
    if joints.judged:
        figures["stream"] = joints.judged.as_json()
    return _Outcome(result, figures, joints.raw, joints.judged)


def _print(figures: dict[str, Any]) -> None:
    print(as_text(figures))
    if "learning_curve" in figures:
        print(f"\n{as_table(figures['learning_curve'])}")
    if "joints" in figures:
        joints = figures["joints"]["accuracy"]
        loss = f"a loss of {100 * (joints - figures['accuracy']):.1f} points"
        print(f"\nfrom pixels, {figures['background']} background; from the joints {joints:.3f}: {loss}")
    if len(figures["views"]) > 1:
        print(f"\n{resolved_pairs(figures)}")
