"""Results of an evaluation: the JSON of the contract, the text, and the figures in one folder."""

import importlib
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from common.errors import BadInput, LabanmeshError
from common.probability import entropy_bits
from fusion.engine.pooling import facing_deg
from studies.evaluate import Answer, Judged, at_end, at_fraction, typical_confusion
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


def truth_of(answer: Answer) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """(N,) indices of the true movements."""
    return np.array([judged.truth for judged in answer.judged])


def as_json(answer: Answer) -> dict[str, Any]:
    """The contract's JSON: `accuracy` after the last frame, `accuracy_at` fractions of the true segment."""
    question, truth = answer.question, truth_of(answer)
    at = {fraction: at_fraction(answer.judged, fraction) for fraction in FRACTIONS}
    views, fused = at_end(answer.judged)
    names = [view.name for view in question.views]
    return {
        "version": 1,
        "n_train": answer.n_train,
        "n_test": len(answer.judged),
        "labels": list(answer.vocabulary.labels),
        "views": names,
        "model": question.model,
        "parameters": dict(question.parameters),
        "rule": question.rule,
        "onset": "known" if question.onset_known else "unknown",
        "turn": "random" if question.turn is None else question.turn,
        "faults": dict(question.faults),
        "temperature": question.temperature,
        "calibrated": question.calibrated,
        "facing": facing_found(answer),
        "seed": question.seed,
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
        "seconds_per_frame": answer.seconds_per_frame,
        "train_seconds": answer.train_seconds,
    }


def facing_found(answer: Answer) -> dict[str, float] | None:
    """How near the judged facing is to the true one at the end; None where nobody judges it."""
    pairs = [(j.faced[-1], j.trial.turn_deg) for j in answer.judged if j.faced is not None]
    if not pairs:
        return None
    astray = np.array([abs((facing_deg(faced) - true + 180) % 360 - 180) for faced, true in pairs])
    return {"within_30_deg": float((astray <= NEAR_DEG).mean()), "median_deg": float(np.median(astray))}


def as_text(found: dict[str, Any]) -> str:
    """What a person reads: what was asked, the accuracy by view and fused over time, and the confusion table."""
    asked = f"{found['model']}, {found['rule']}, onset {found['onset']}, turn {found['turn']}"
    width = max(len(name) for name in [*found["views"], "fused"])
    head = " " * width + "".join(f"{float(f):>7.0%}" for f in found["accuracy_at"]) + "    end"
    rows = [*((name, found["per_view"][name]) for name in found["views"]), ("fused", found)]
    lines = [
        f"{name:<{width}}" + "".join(f"{a:>7.3f}" for a in row["accuracy_at"].values()) + f"{row['accuracy']:>7.3f}"
        for name, row in rows
    ]
    table = confusion_table(
        np.array(found["confusion"]), found["labels"], "judged (columns) against true (rows), fused"
    )
    return "\n".join(
        [
            f"{found['n_train']} recordings learned, {found['n_test']} judged; {asked}",
            "",
            "right, when so much of the movement was seen:",
            head,
            *lines,
            "",
            f"calibration error {found['ece']:.3f} ({_each(found, 'ece')}), Brier {found['brier']:.3f}, "
            f"log loss {found['log_loss']:.3f}",
            *_facing(found),
            f"learned in {found['train_seconds']:.1f} s, {found['seconds_per_frame'] * 1e3:.2f} ms a frame and view",
            *_extras(found),
            "",
            table,
        ]
    )


def _by_threshold(rows: list[dict[str, Any]]) -> list[str]:
    """What a home may choose between by [fusion] threshold, of the first word and of the last."""
    names = ("unlearned_named", "recall", "f1")
    head = "threshold  named  right     F1, last word: named  right     F1"
    return [
        head,
        *(
            f"{row['threshold']:9.2f}"
            + "".join(f"{row[name]:7.3f}" for name in names)
            + " " * 13
            + "".join(f"{row[name + '_last_word']:7.3f}" for name in names)
            for row in rows
        ),
    ]


def _each(found: dict[str, Any], figure: str) -> str:
    return ", ".join(f"{name} {found['per_view'][name][figure]:.3f}" for name in found["views"])


def _facing(found: dict[str, Any]) -> list[str]:
    if found["facing"] is None:
        return []
    facing = found["facing"]
    return [f"facing within 30 degrees in {facing['within_30_deg']:.1%}, median {facing['median_deg']:.1f} degrees"]


def _extras(found: dict[str, Any]) -> list[str]:
    """What only some evaluations ask for: the same over the mesh, and streams."""
    lines = []
    if "mesh" in found:
        mesh = found["mesh"]
        lines.append(
            f"over the mesh: {mesh['same_labels']} of {mesh['n']} labels the same, right {mesh['accuracy']:.3f}"
        )
    if "stream" in found:
        said = found["stream"]
        latency = "none" if said["median_latency_s"] is None else f"{said['median_latency_s']:.2f} s"
        lines.append(
            f"in streams: F1 {said['f1']:.3f}, precision {said['precision']:.3f}, recall {said['recall']:.3f}, "
            f"{said['false_alarms_per_minute']:.2f} false alarms a minute of rest, median latency {latency}; "
            f"when the last word counts F1 {said['f1_last_word']:.3f}"
        )
        if said["unlearned"]:
            lines.append(
                f"of {said['unlearned']} movements not learned {said['unlearned_named']:.1%} were given a name, "
                f"{said['unlearned_named_last_word']:.1%} when the last word counts"
            )
            lines += _by_threshold(said["by_threshold"])
    return lines


RESOLVED_SHOWN = 10


def write_report(answer: Answer, found: dict[str, Any], folder: Path, raw: Answer | None = None) -> list[Path]:
    """Write everything into `folder`, made if needed; returns the files. raw: the same, judged uncalibrated.

    Raises BadInput when the folder cannot be made, LabanmeshError where matplotlib is missing.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = folder / "report.txt"
        text.write_text(_text(found), encoding="utf-8")
    except OSError as error:
        raise BadInput(f"--report {folder}: {error.strerror}") from None
    told = [belief_of(j, found["views"], found["labels"], folder) for j in tellings(answer.judged, len(found["views"]))]
    reliability = [_reliability(answer, folder / "reliability.png")]
    if raw is not None:
        reliability.append(_reliability(raw, folder / "reliability-uncalibrated.png"))
    return [text, *_confusions(found, folder), _earliness(found, folder), *reliability, *told]


def figures() -> ModuleType:
    """The figures' room; raises LabanmeshError where matplotlib is missing."""
    try:
        return importlib.import_module("studies.figures")
    except ImportError:
        raise LabanmeshError("figures are drawn with matplotlib: pip install 'labanmesh[report]'") from None


def _confusions(found: dict[str, Any], folder: Path) -> list[Path]:
    def draw(name: str, counts: list[list[int]], title: str) -> Path:
        path = folder / f"confusion-{_file(name)}.png"
        drawn: Path = figures().confusion_figure(np.array(counts), found["labels"], title, path)
        return drawn

    views = [draw(name, found["per_view"][name]["confusion"], f"{name}: {found['model']}") for name in found["views"]]
    return [*views, draw("fused", found["confusion"], f"fused: {found['model']}, {found['rule']}")]


def _earliness(found: dict[str, Any], folder: Path) -> Path:
    series = {name: list(found["per_view"][name]["accuracy_at"].values()) for name in found["views"]}
    series["fused"] = list(found["accuracy_at"].values())
    chance = 1 / len(found["labels"])
    drawn: Path = figures().earliness_figure(FRACTIONS, series, folder / "early-recognition.png", chance=chance)
    return drawn


def _reliability(answer: Answer, path: Path) -> Path:
    truth, (views, fused) = truth_of(answer), at_end(answer.judged)
    names = [view.name for view in answer.question.views]
    beliefs = {**{name: views[:, v] for v, name in enumerate(names)}, "fused": fused}
    series = {name: (p.max(axis=1), p.argmax(axis=1) == truth) for name, p in beliefs.items()}
    ece = {name: expected_calibration_error(p, truth) for name, p in beliefs.items()}
    drawn: Path = figures().reliability_figure(series, ece, path)
    return drawn


def belief_of(judged: Judged, names: Sequence[str], labels: Sequence[str], folder: Path) -> Path:
    """The paper's Fig. 7 for one trial: belief and entropy by observer and fused."""
    beliefs = {**{n: judged.views[:, v] for v, n in enumerate(names)}, "fused": judged.fused}
    times_s = np.arange(len(judged.fused)) / judged.trial.recording.rate_hz
    path = folder / f"belief-{_file(judged.trial.name)}.png"
    entropies = {name: entropy_bits(p) for name, p in beliefs.items()}
    drawn: Path = figures().belief_figure(times_s, beliefs, entropies, labels, labels[judged.truth], path)
    return drawn


def tellings(judged: Sequence[Judged], views: int) -> list[Judged]:
    """For each view the trial that tells most: it erred there, and the fusion did not; else the first trial."""
    found = [next(typical_confusion(judged, view), None) for view in range(views)] if views > 1 else []
    chosen = [j for j in found if j is not None]
    return list({id(j): j for j in chosen}.values()) or list(judged[:1])


def resolved_pairs(found: dict[str, Any]) -> str:
    """The movements that one view confuses and the fusion resolves, as the paper's nthrow and ok."""
    lines = []
    for name in found["views"]:
        one, fused = np.array(found["per_view"][name]["confusion"]), np.array(found["confusion"])
        lines += [
            f"{name}: {pair.true} taken for {pair.judged} {pair.count_in_one_view} times, {pair.count_fused} fused"
            for pair in confused_pairs(one, fused, found["labels"])[:RESOLVED_SHOWN]
        ]
    return "\n".join(["what one view confuses and the fusion resolves:", *(lines or ["nothing"])])


def _text(found: dict[str, Any]) -> str:
    tables = [
        confusion_table(np.array(found["per_view"][name]["confusion"]), found["labels"], name)
        for name in found["views"]
    ]
    resolved = [resolved_pairs(found)] if len(found["views"]) > 1 else []
    return "\n\n".join([as_text(found), *tables, *resolved]) + "\n"


def _file(name: str) -> str:
    return "".join(c if c.isalnum() or c in "._-" else "-" for c in name)


def draw_learning_curve(curve: dict[str, Any], path: Path) -> Path:
    """The figure of `--learning-curve`."""
    titles = {"people": "people learned from", "recordings": f"recordings of each of {curve['n_people']} people"}
    panels = {
        title: (
            [point["n"] for point in curve[kind]],
            {name: [p["per_view"][name] for p in curve[kind]] for name in curve[kind][0]["per_view"]}
            | {"fused": [p["accuracy"] for p in curve[kind]]},
            [(p["least"], p["most"]) for p in curve[kind]],
        )
        for kind, title in titles.items()
    }
    drawn: Path = figures().learning_figure(panels, path)
    return drawn
