"""Results of an evaluation: the JSON of the contract, the text for people, and the figures in one folder."""

import importlib
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from common.errors import BadInput, LabanmeshError, reason_of
from common.probability import entropy_bits
from common.text import plural
from studies.evaluate import EvaluationResult, TrialResult
from studies.fusion_engine import facing_deg
from studies.metrics import (
    accuracy,
    brier,
    confused_pairs,
    confusion,
    confusion_table,
    expected_calibration_error,
    log_loss,
)

FRACTIONS = (0.2, 0.4, 0.6, 0.8, 1.0)
NEAR_DEG = 30.0
RESOLVED_SHOWN = 10


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
        "room": [f"{event.kind}={event.number:g}" for event in settings.room],
        "temperature": settings.temperature,
        "calibrated": settings.calibrated,
        "facing": _facing_errors(result),
        "seed": settings.seed,
        "accuracy": accuracy(fused, truth),
        "accuracy_at": {str(f): accuracy(p, truth) for f, (_, p) in at.items()},
        "confusion": confusion(fused, truth).tolist(),
        "ece": expected_calibration_error(fused, truth),
        "brier": brier(fused, truth),
        "log_loss": log_loss(fused, truth),
        "per_view": {
            name: {
                "accuracy": accuracy(views[:, v], truth),
                "accuracy_at": {str(f): accuracy(p[:, v], truth) for f, (p, _) in at.items()},
                "mean_entropy_bits": float(entropy_bits(views[:, v]).mean()),
                "ece": expected_calibration_error(views[:, v], truth),
                "confusion": confusion(views[:, v], truth).tolist(),
            }
            for v, name in enumerate(names)
        },
        "seconds_per_frame": result.seconds_per_frame,
        "train_seconds": result.train_seconds,
    }


def _facing_errors(result: EvaluationResult) -> dict[str, float] | None:
    """Error of the fused facing at the end; None where no model knows facings."""
    pairs = [(r.fused_facing[-1], r.trial.turn_deg) for r in result.trials if r.fused_facing is not None]
    if not pairs:
        return None
    errors_deg = np.array([abs((facing_deg(facing) - true + 180) % 360 - 180) for facing, true in pairs])
    return {"within_30_deg": float((errors_deg <= NEAR_DEG).mean()), "median_deg": float(np.median(errors_deg))}


def as_text(figures: dict[str, Any]) -> str:
    """For people: the settings, the accuracy by view and fused over time, and the confusion table."""
    settings = f"{figures['model']}, {figures['rule']}, onset {figures['onset']}, turn {figures['turn']}"
    width = max(len(name) for name in [*figures["views"], "fused"])
    head = " " * width + "".join(f"{float(f):>7.0%}" for f in figures["accuracy_at"]) + "    end"
    rows = [*((name, figures["per_view"][name]) for name in figures["views"]), ("fused", figures)]
    lines = [
        f"{name:<{width}}" + "".join(f"{a:>7.3f}" for a in row["accuracy_at"].values()) + f"{row['accuracy']:>7.3f}"
        for name, row in rows
    ]
    calibration = ", ".join(f"{name} {figures['per_view'][name]['ece']:.3f}" for name in figures["views"])
    table = confusion_table(
        np.array(figures["confusion"]), figures["labels"], "judged (columns) against true (rows), fused"
    )
    parts = [
        f"{plural(figures['n_train'], 'recording')} learned, {figures['n_test']} judged; {settings}",
        "",
        "accuracy after this share of the movement:",
        head,
        *lines,
        "",
        f"calibration error {figures['ece']:.3f} ({calibration}), Brier {figures['brier']:.3f}, "
        f"log loss {figures['log_loss']:.3f}",
        *_facing_text(figures),
        f"learned in {figures['train_seconds']:.1f} s, {figures['seconds_per_frame'] * 1e3:.2f} ms per frame and view",
        *extra_text(figures),
        "",
        table,
    ]
    return "\n".join(parts)


def _facing_text(figures: dict[str, Any]) -> list[str]:
    facing = figures["facing"]
    if facing is None:
        return []
    return [f"facing within 30 degrees in {facing['within_30_deg']:.1%}, median {facing['median_deg']:.1f} degrees"]


def extra_text(figures: dict[str, Any]) -> list[str]:
    """The lines of --through mesh and of --stream."""
    lines = []
    if "mesh" in figures:
        mesh = figures["mesh"]
        lines.append(
            f"over the mesh: {mesh['same_labels']} of {mesh['n']} labels equal, accuracy {mesh['accuracy']:.3f}"
        )
    if "stream" in figures:
        stream = figures["stream"]
        latency = "none" if stream["median_latency_s"] is None else f"{stream['median_latency_s']:.2f} s"
        lines.append(
            f"in streams: F1 {stream['f1']:.3f}, precision {stream['precision']:.3f}, recall {stream['recall']:.3f}, "
            f"{stream['false_alarms_per_minute']:.2f} false alarms a minute of rest, median latency {latency}; "
            f"by the last word F1 {stream['f1_last_word']:.3f}"
        )
        if stream["unlearned"]:
            lines.append(
                f"{stream['unlearned_named']:.1%} of {plural(stream['unlearned'], 'unlearned movement')} got a label, "
                f"{stream['unlearned_named_last_word']:.1%} by the last word"
            )
            lines += _by_threshold(stream["by_threshold"])
    return lines


def _by_threshold(rows: list[dict[str, Any]]) -> list[str]:
    """The trade-off that [fusion] threshold controls, by the first and the last word of the verdicts."""
    names = ("unlearned_named", "recall", "f1")
    lines = ["threshold  named recall     F1, last word: named recall     F1"]
    for row in rows:
        first = "".join(f"{row[name]:7.3f}" for name in names)
        last = "".join(f"{row[name + '_last_word']:7.3f}" for name in names)
        lines.append(f"{row['threshold']:9.2f}{first}{'':13}{last}")
    return lines


def resolved_pairs(figures: dict[str, Any]) -> str:
    """The movements that one view confuses and fusion tells apart, as nthrow and ok in the paper."""
    lines = []
    for name in figures["views"]:
        one, fused = np.array(figures["per_view"][name]["confusion"]), np.array(figures["confusion"])
        lines += [
            f"{name}: {pair.true} as {pair.judged} {plural(pair.count_in_one_view, 'time')}, fused {pair.count_fused}"
            for pair in confused_pairs(one, fused, figures["labels"])[:RESOLVED_SHOWN]
        ]
    return "\n".join(["confusions of one view that fusion resolves:", *(lines or ["none"])])


def write_report(
    result: EvaluationResult, figures: dict[str, Any], folder: Path, uncalibrated: EvaluationResult | None = None
) -> list[Path]:
    """Write text and figures into `folder`, made if needed; returns the files. uncalibrated: for a second diagram.

    Raises BadInput when the folder cannot be written, LabanmeshError where matplotlib is missing.
    """
    make_folder(folder, "--report")
    views = figures["views"]
    tables = [
        confusion_table(np.array(figures["per_view"][name]["confusion"]), figures["labels"], name) for name in views
    ]
    resolved = [resolved_pairs(figures)] if len(views) > 1 else []
    text = write_text(folder / "report.txt", "\n\n".join([as_text(figures), *tables, *resolved]) + "\n", "--report")
    reliability = [_reliability(result, folder / "reliability.png")]
    if uncalibrated is not None:
        reliability.append(_reliability(uncalibrated, folder / "reliability-uncalibrated.png"))
    typical = [_belief(r, views, figures["labels"], folder) for r in _resolved_trials(result.trials, len(views))]
    return [text, *_confusions(figures, folder), _earliness(figures, folder), *reliability, *typical]


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
    series = {name: (p.max(axis=1), p.argmax(axis=1) == truth) for name, p in beliefs.items()}
    ece = {name: expected_calibration_error(p, truth) for name, p in beliefs.items()}
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
        resolved = [r for r in trials if r.views[-1, view].argmax() != r.truth and r.fused[-1].argmax() == r.truth]
        if resolved:
            best = max(resolved, key=lambda r: float(r.fused[-1, r.truth]))
            chosen[id(best)] = best
    return list(chosen.values()) or list(trials[:1])


def draw_learning_curve(curve: dict[str, Any], path: Path) -> Path:
    """The figure of `--learning-curve`."""
    people = plural(curve["n_people"], "person", "people")
    titles = {"people": "people learned from", "recordings": f"recordings of each of {people}"}
    panels = {
        title: (
            [point["n"] for point in curve[kind]],
            {name: [p["per_view"][name] for p in curve[kind]] for name in curve[kind][0]["per_view"]}
            | {"fused": [p["accuracy"] for p in curve[kind]]},
            [(p["least"], p["most"]) for p in curve[kind]],
        )
        for kind, title in titles.items()
    }
    return _draw("learning_figure", panels, path)


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in "._-" else "-" for c in name)


def make_folder(folder: Path, option: str) -> None:
    """Make a folder and its parents; raises BadInput that names the option for another one."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(
            f"cannot make the folder {folder}: {reason_of(error)}. Choose another one with {option}"
        ) from None


def write_text(path: Path, text: str, option: str) -> Path:
    """Write a file and return its path; raises BadInput that names the option for another path."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"cannot write {path}: {reason_of(error)}. Choose another path with {option}") from None
    return path
