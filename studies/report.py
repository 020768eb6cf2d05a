"""The report of an evaluation: tables as text, figures as pictures, in one folder."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import BadInput, LabanmeshError
from common.probability import entropy_bits
from studies.answer import FRACTIONS, as_text, truth_of
from studies.evaluate import Answer, Judged, at_end, typical_confusion
from studies.tables import confused_pairs, confusion_table

RESOLVED_SHOWN = 10


def write_report(answer: Answer, found: dict[str, Any], folder: Path) -> list[Path]:
    """Write everything into `folder`, made if needed; returns the files.

    Raises BadInput when the folder cannot be made, LabanmeshError where matplotlib is missing.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"--report {folder}: {error.strerror}") from None
    try:
        from studies import figures
    except ImportError:
        raise LabanmeshError("--report draws with matplotlib: pip install 'labanmesh[report]'") from None
    text = folder / "report.txt"
    text.write_text(_text(found), encoding="utf-8")
    names, labels, truth = found["views"], found["labels"], truth_of(answer)
    views, fused = at_end(answer.judged)
    written = [text]
    for name, counts in [*((n, found["per_view"][n]["confusion"]) for n in names), ("fused", found["confusion"])]:
        title = f"{name}: {found['model']}" + (f", {found['rule']}" if name == "fused" else "")
        path = folder / f"confusion-{_file(name)}.png"
        written.append(figures.confusion_figure(np.array(counts), labels, title, path))
    series = {n: list(found["per_view"][n]["accuracy_at"].values()) for n in names}
    series["fused"] = list(found["accuracy_at"].values())
    early = folder / "early-recognition.png"
    written.append(figures.earliness_figure(FRACTIONS, series, early, chance=1 / len(labels)))
    all_p = {**{n: views[:, v] for v, n in enumerate(names)}, "fused": fused}
    sureness = {n: (p.max(axis=1), p.argmax(axis=1) == truth) for n, p in all_p.items()}
    ece = {**{n: found["per_view"][n]["ece"] for n in names}, "fused": found["ece"]}
    written.append(figures.reliability_figure(sureness, ece, folder / "reliability.png"))
    for judged in tellings(answer.judged, len(names)):
        written.append(belief_of(judged, names, labels, folder))
    return written


def belief_of(judged: Judged, names: Sequence[str], labels: Sequence[str], folder: Path) -> Path:
    """The paper's Fig. 7 for one trial: belief and entropy by observer and fused."""
    from studies.figures import belief_figure

    beliefs = {**{n: judged.views[:, v] for v, n in enumerate(names)}, "fused": judged.fused}
    times_s = np.arange(len(judged.fused)) / judged.trial.recording.rate_hz
    path = folder / f"belief-{_file(judged.trial.name)}.png"
    entropies = {name: entropy_bits(p) for name, p in beliefs.items()}
    return belief_figure(times_s, beliefs, entropies, labels, labels[judged.truth], path)


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
        for pair in confused_pairs(one, fused, found["labels"])[:RESOLVED_SHOWN]:
            times = f"{pair.count_in_one_view} times, {pair.count_fused} fused"
            lines.append(f"{name}: {pair.true} taken for {pair.judged} {times}")
    return "\n".join(["what one view confuses and the fusion resolves:", *(lines or ["nothing"])])


def _text(found: dict[str, Any]) -> str:
    parts = [as_text(found)]
    for name in found["views"]:
        parts.append(confusion_table(np.array(found["per_view"][name]["confusion"]), found["labels"], name))
    if len(found["views"]) > 1:
        parts.append(resolved_pairs(found))
    return "\n\n".join(parts) + "\n"


def _file(name: str) -> str:
    return "".join(c if c.isalnum() or c in "._-" else "-" for c in name)
