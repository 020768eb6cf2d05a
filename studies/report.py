"""Results of an evaluation: the JSON of the contract, and text and figures in one folder."""

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import LabanmeshError
from common.probability import entropy_bits
from observer.tracks import Floats
from studies.evaluate import EvaluationResult, TrialResult
from studies.fusion_engine import facing_deg
from studies.metrics import (
    accuracy,
    brier,
    confusion,
    confusion_table,
    expected_calibration_error,
    log_loss,
)
from studies.output_files import make_folder, write_text
from studies.report_text import as_text, resolved_pairs
from studies.spotting import JudgedStream, StreamResult, by_person, spans_hit

FRACTIONS = (0.2, 0.4, 0.6, 0.8, 1.0)
NEAR_DEG = 30.0


def as_json(result: EvaluationResult) -> dict[str, Any]:
    """The contract's JSON: `accuracy` after the last frame, `accuracy_at` fractions of the true segment."""
    settings, truth = result.settings, result.truth
    at = {fraction: result.at_fraction(fraction) for fraction in FRACTIONS}
    views, fused = result.at_end()
    names = [view.name for view in settings.views]
    return {
        "version": 1,
        "n_train": result.n_train,
        "n_test": len(result.trials),
        "labels": list(result.vocabulary.labels),
        "views": names,
        "model": settings.model,
        "parameters": dict(settings.parameters),
        "rule": settings.rule,
        "onset": "known" if settings.onset_known else "unknown",
        "turn": "random" if settings.turn is None else settings.turn,
        "faults": dict(settings.faults),
        "calibrated": settings.calibrated,
        "facing": _facing_errors(result),
        "seed": settings.seed,
        "accuracy": accuracy(fused, truth),
        "accuracy_at": {str(f): accuracy(p, truth) for f, (_, p) in at.items()},
        "confusion": confusion(fused, truth).tolist(),
        "ece": expected_calibration_error(fused, truth),
        **_first_words(result),
        **_complete(result),
        "brier": brier(fused, truth),
        "log_loss": log_loss(fused, truth),
        "per_view": {
            name: _of_view(views[:, v], {f: p[:, v] for f, (p, _) in at.items()}, truth) for v, name in enumerate(names)
        },
        "sensors": bool(settings.sensors),
        "seconds_per_frame": result.seconds_per_frame,
        "train_seconds": result.train_seconds,
    }


def _of_view(p: Floats, at: Mapping[float, Floats], truth: NDArray[np.int64]) -> dict[str, Any]:
    """One observer's figures, from the N trials that its sensor recorded; p (N, M), at each fraction (N, M)."""
    recorded = np.isfinite(p[:, 0])
    p, truth = p[recorded], truth[recorded]
    return {
        "n_test": int(recorded.sum()),
        "accuracy": accuracy(p, truth),
        "accuracy_at": {str(f): accuracy(some[recorded], truth) for f, some in at.items()},
        "mean_entropy_bits": float(entropy_bits(p).mean()),
        "ece": expected_calibration_error(p, truth),
        "confusion": confusion(p, truth).tolist(),
    }


def _first_words(result: EvaluationResult) -> dict[str, Any]:
    """Verdicts that name a movement during a trial: how often, when, how right, and how sure the belief is then."""
    words = [(r, *r.first_word) for r in result.trials if r.first_word is not None]
    if all(r.rest is None for r in result.trials):
        return {}
    p, truth = np.array([r.fused[frame] for r, frame, _ in words]), np.array([r.truth for r, _, _ in words])
    lengths = [(frame + 1 - r.trial.begin) / (r.trial.end - r.trial.begin) for r, frame, _ in words]
    seconds = [(frame - r.trial.begin) / r.trial.recording.rate_hz for r, frame, _ in words]
    return {
        "ece_first_word": expected_calibration_error(p, truth) if words else None,
        "first_word": {
            "coverage": len(words) / len(result.trials),
            "accuracy": sum(label == r.truth for r, _, label in words) / len(words) if words else None,
            "median_fraction": float(np.median(lengths)) if words else None,
            "median_latency_s": float(np.median(seconds)) if words else None,
        },
    }


def _complete(result: EvaluationResult) -> dict[str, Any]:
    """With sensors: the performances that all of them recorded."""
    if not result.settings.sensors:
        return {}
    whole = [r for r in result.trials if r.judged_by.all()]
    if not whole:
        return {"complete": {"n_test": 0}}
    truth = np.array([r.truth for r in whole])
    at = {str(f): accuracy(np.array([r.fused[r.trial.frame_at(f)] for r in whole]), truth) for f in FRACTIONS}
    p = np.array([r.fused[-1] for r in whole])
    return {"complete": {"n_test": len(whole), "accuracy": accuracy(p, truth), "accuracy_at": at}}


def _facing_errors(result: EvaluationResult) -> dict[str, float] | None:
    """Error of the fused facing at the end; None where no model knows facings."""
    pairs = [(r.fused_facing[-1], r.trial.turn_deg) for r in result.trials if r.fused_facing is not None]
    if not pairs:
        return None
    errors_deg = np.array([abs((facing_deg(facing) - true + 180) % 360 - 180) for facing, true in pairs])
    return {"within_30_deg": float((errors_deg <= NEAR_DEG).mean()), "median_deg": float(np.median(errors_deg))}


def write_report(result: EvaluationResult, figures: dict[str, Any], folder: Path) -> list[Path]:
    """Write text and figures into `folder`, made if needed; returns the files.

    Raises BadInput when the folder cannot be written, LabanmeshError where matplotlib is missing.
    """
    make_folder(folder, "--report")
    views = figures["views"]
    tables = [
        confusion_table(np.array(figures["per_view"][name]["confusion"]), figures["labels"], name) for name in views
    ]
    resolved = [resolved_pairs(figures)] if len(views) > 1 else []
    text = write_text(folder / "report.txt", "\n\n".join([as_text(figures), *tables, *resolved]) + "\n", "--report")
    reliability = _reliability(result, folder / "reliability.png")
    typical = [_belief(r, views, figures["labels"], folder) for r in _resolved_trials(result.trials, len(views))]
    return [text, *_confusions(figures, folder), _earliness(figures, folder), reliability, *typical]


def figures() -> ModuleType:
    """The module of the figures; raises LabanmeshError where matplotlib is missing."""
    try:
        return importlib.import_module("studies.figures")
    except ImportError:
        raise LabanmeshError("matplotlib is not installed; pip install 'labanmesh[report]'") from None


def _draw(figure: str, *arguments: Any, **options: Any) -> Path:  # noqa: ANN401 - those of the figure
    path: Path = getattr(figures(), figure)(*arguments, **options)
    return path


def _confusions(summary: dict[str, Any], folder: Path) -> list[Path]:
    def draw(name: str, counts: list[list[int]], extra: str = "") -> Path:
        path, title = folder / f"confusion-{_file_name(name)}.png", f"{name}: {summary['model']}{extra}"
        return _draw("confusion_figure", np.array(counts), summary["labels"], title, path)

    views = [draw(name, summary["per_view"][name]["confusion"]) for name in summary["views"]]
    return [*views, draw("fused", summary["confusion"], f", {summary['rule']}")]


def _earliness(summary: dict[str, Any], folder: Path) -> Path:
    series = {name: list(summary["per_view"][name]["accuracy_at"].values()) for name in summary["views"]}
    series["fused"] = list(summary["accuracy_at"].values())
    chance = 1 / len(summary["labels"])
    return _draw("earliness_figure", FRACTIONS, series, folder / "early-recognition.png", chance=chance)


def _reliability(result: EvaluationResult, path: Path) -> Path:
    truth, (views, fused) = result.truth, result.at_end()
    names = [view.name for view in result.settings.views]
    beliefs = {**{name: views[:, v] for v, name in enumerate(names)}, "fused": fused}
    recorded = {name: np.isfinite(p[:, 0]) for name, p in beliefs.items()}
    judged = {name: (p[recorded[name]], truth[recorded[name]]) for name, p in beliefs.items()}
    series = {name: (p.max(axis=1), p.argmax(axis=1) == own) for name, (p, own) in judged.items()}
    ece = {name: expected_calibration_error(p, own) for name, (p, own) in judged.items()}
    return _draw("reliability_figure", series, ece, path)


def _belief(result: TrialResult, names: Sequence[str], labels: Sequence[str], folder: Path) -> Path:
    """The paper's Fig. 7 for one trial: posterior and entropy by observer and fused."""
    beliefs = {**{n: result.views[:, v] for v, n in enumerate(names)}, "fused": result.fused}
    times_s = np.arange(len(result.fused)) / result.trial.recording.rate_hz
    path = folder / f"belief-{_file_name(result.trial.name)}.png"
    entropies = {name: entropy_bits(p) for name, p in beliefs.items()}
    return _draw("belief_figure", times_s, beliefs, entropies, labels, labels[result.truth], path)


def _resolved_trials(trials: Sequence[TrialResult], views: int) -> list[TrialResult]:
    """For each view the trial that it gets wrong and fusion gets right most clearly; else the first trial."""
    chosen: dict[int, TrialResult] = {}
    for view in range(views) if views > 1 else ():
        whole = [r for r in trials if r.judged_by.all()]
        resolved = [r for r in whole if r.views[-1, view].argmax() != r.truth and r.fused[-1].argmax() == r.truth]
        if resolved:
            best = max(resolved, key=lambda r: float(r.fused[-1, r.truth]))
            chosen[id(best)] = best
    return list(chosen.values()) or [r for r in trials if r.judged_by.all()][:1]


def draw_streams(result: StreamResult, folder: Path) -> list[Path]:
    """One timeline per person: truth, first words and last words; other motion in figures of its own."""
    kinds = {"stream": result.streams, "other-motion": result.other_motion}
    return [
        _draw(
            "stream_timeline_figure",
            [_timeline(stream) for stream in streams],
            f"{kind.replace('-', ' ')} of {person}",
            folder / f"{kind}-{_file_name(person)}.png",
        )
        for kind, judged in kinds.items()
        for person, streams in by_person(_once(judged)).items()
    ]


def _once(streams: Sequence[JudgedStream]) -> list[JudgedStream]:
    """Each stream once: other motion is judged by the models of every fold."""
    return list({(s.recording.subject, s.recording.trial): s for s in reversed(streams)}.values())[::-1]


def _timeline(stream: JudgedStream) -> Any:  # noqa: ANN401 - matplotlib may be missing
    drawing, recording = figures(), stream.recording
    rate, length_s = recording.rate_hz, len(recording.positions) / recording.rate_hz
    by_last = [replace(verdict, label=verdict.last) for verdict in stream.verdicts]
    hits = zip(stream.verdicts, spans_hit(stream.verdicts, recording), spans_hit(by_last, recording), strict=True)
    verdicts = [
        drawing.VerdictBar(
            v.label,
            v.at_s,
            v.last,
            v.at_s if v.began_s is None else v.began_s,
            length_s if v.ended_s is None else v.ended_s,
            first is not None,
            last is not None,
        )
        for v, first, last in hits
    ]
    truth = [drawing.LabelledInterval(s.start / rate, s.end / rate, s.label) for s in recording.spans]
    return drawing.StreamTimeline(f"trial {recording.trial}", length_s, truth, verdicts)


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in "._-" else "-" for c in name)


def prepare_report(folder: Path) -> None:
    """Check before the long work that a report can be written, and make its folder; raises as `write_report` does."""
    figures()
    make_folder(folder, "--report")
