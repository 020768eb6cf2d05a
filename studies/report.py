"""The report of an evaluation: tables as text, figures as pictures, in one folder."""

import importlib
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from common.errors import BadInput, LabanmeshError
from common.probability import entropy_bits
from studies.answer import FRACTIONS, as_text, truth_of
from studies.evaluate import Answer, Judged, at_end, typical_confusion
from studies.metrics import expected_calibration_error
from studies.tables import confused_pairs, confusion_table

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
