"""What was done, what was judged and what was believed, over one time axis."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.patches import Rectangle

from common.vocabulary import ABSTAIN
from studies.figures.style import COLOURS, INK, Axes, Figure, Floats, plain, save

TRUE, RIGHT, WRONG, UNDECIDED = INK, COLOURS[2], COLOURS[1], "#999999"
ROWS = 10
"""Movements shown at most: those performed or judged, then those most believed in."""


class Span(NamedTuple):
    """A movement in time, seconds; as truth or as verdict."""

    start_s: float
    end_s: float
    label: str


def verdict_timeline_figure(
    times_s: Floats, belief: Floats, labels: Sequence[str], truth: Sequence[Span], verdicts: Sequence[Span], path: Path
) -> Path:
    """Strips of what was done and what was judged, over the fused belief (F, M) at times_s (F,) as a map.

    A verdict is right (green) when it overlaps a true span of its label; `abstain` is grey; others are
    orange and hatched. True spans are framed in the map. Returns `path`.
    """
    rows = _rows(belief, labels, truth, verdicts)
    width = float(np.clip(0.35 * (times_s[-1] - times_s[0]), 7, 16))
    figure = Figure(figsize=(width, 1.5 + 0.24 * len(rows)), layout="constrained")
    strips, field = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (2, max(len(rows), 3))})
    for span in truth:
        _box(strips, span, 1, TRUE, hatched=False)
    for span in verdicts:
        colour = UNDECIDED if span.label == ABSTAIN else RIGHT if _is_right(span, truth) else WRONG
        _box(strips, span, 0, colour, hatched=colour == WRONG)
    strips.set_yticks([0.4, 1.4], ["verdict", "done"], fontsize=8)
    strips.set_ylim(0, 1.95)
    strips.tick_params(bottom=False, left=False)
    strips.spines[:].set_visible(False)
    _map(field, times_s, belief, labels, rows, truth)
    field.set_xlabel("time (s)", fontsize=9)
    field.set_xlim(times_s[0], times_s[-1])
    return save(figure, path)


def _rows(belief: Floats, labels: Sequence[str], truth: Sequence[Span], verdicts: Sequence[Span]) -> list[str]:
    """The labels to show, in the vocabulary's order."""
    mentioned = {span.label for span in (*truth, *verdicts)}
    peak = belief.max(axis=0)
    ranked = sorted(labels, key=lambda label: (label not in mentioned, -peak[labels.index(label)]))
    kept = set(ranked[: max(ROWS, len(mentioned))])
    return [label for label in labels if label in kept]


def _is_right(verdict: Span, truth: Sequence[Span]) -> bool:
    return any(
        verdict.label == true.label and verdict.start_s < true.end_s and true.start_s < verdict.end_s for true in truth
    )


def _box(axes: Axes, span: Span, level: int, colour: str, hatched: bool) -> None:
    width = span.end_s - span.start_s
    face = (span.start_s, level)
    axes.add_patch(Rectangle(face, width, 0.8, facecolor=colour, alpha=0.18, linewidth=0))
    axes.add_patch(Rectangle(face, width, 0.8, fill=False, edgecolor=colour, hatch="///" if hatched else None))
    name = span.label.replace("_", " ")
    ground = {"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 1} if hatched else None
    axes.text(span.start_s + width / 2, level + 0.4, name, ha="center", va="center", fontsize=8, color=INK, bbox=ground)


def _map(
    axes: Axes, times_s: Floats, belief: Floats, labels: Sequence[str], rows: Sequence[str], truth: Sequence[Span]
) -> None:
    """The fused belief as shades, one line for each movement, white up to chance; the true spans are framed."""
    shown = belief[:, [labels.index(label) for label in rows]]
    axes.pcolormesh(
        times_s, np.arange(len(rows)), shown.T, cmap="Blues", vmin=1 / len(labels), vmax=1, shading="nearest"
    )
    for span in truth:
        if span.label in rows:
            corner = (span.start_s, rows.index(span.label) - 0.5)
            axes.add_patch(Rectangle(corner, span.end_s - span.start_s, 1, fill=False, edgecolor=INK, linewidth=1.2))
    axes.set_yticks(range(len(rows)), [label.replace("_", " ") for label in rows], fontsize=8)
    axes.invert_yaxis()
    plain(axes)
