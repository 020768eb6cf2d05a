"""Figures over time: belief and entropy (the paper's Fig. 7), and verdicts against truth."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.patches import Rectangle

from common.vocabulary import ABSTAIN
from studies.figures.accuracy import COLOURS, GREY, INK, Axes, Figure, Floats, plain, save, spread

NAMED = 4
"""Movements with a colour and a name beside the true one."""
WORTH_NAMING = 0.08
"""A line that ends below this probability is not named in this column."""
WORTH_COLOUR = 0.1
"""Least mean probability in some column for a movement to get a colour."""
LABEL_GAP = 0.09
COLUMN_INCHES = 2.7


def belief_figure(
    times_s: Floats,
    beliefs: Mapping[str, Floats],
    entropies: Mapping[str, Floats],
    labels: Sequence[str],
    truth: str,
    path: Path,
) -> Path:
    """Fig. 7: one column for each of `beliefs` ((F, M) by name, fused last), P above, entropy (F,) below.

    times_s is (F,) in seconds, entropies in bits under the same names. The true movement is drawn thick;
    the most probable others have a colour and a name, the rest is grey. Returns `path`.
    """
    figure = Figure(figsize=(COLUMN_INCHES * len(beliefs) + 0.5, 4.2), layout="constrained")
    grid = figure.subplots(
        2, len(beliefs), sharex=True, sharey="row", squeeze=False, gridspec_kw={"height_ratios": (2.2, 1)}
    )
    colours = _colours(beliefs, labels, truth)
    top_bits = max(np.log2(len(labels)), 0.1)
    for column, (name, belief) in enumerate(beliefs.items()):
        upper, lower = grid[0, column], grid[1, column]
        upper.set_title(name, fontsize=10, loc="left", fontweight="bold" if column == len(beliefs) - 1 else None)
        _draw_beliefs(upper, times_s, belief, labels, truth, colours)
        lower.fill_between(times_s, entropies[name], color=GREY, alpha=0.35, linewidth=0)
        lower.plot(times_s, entropies[name], color="#444444", linewidth=1.4)
        lower.set_ylim(0, top_bits * 1.02)
        lower.set_xlabel("time (s)", fontsize=9)
        plain(upper)
        plain(lower)
        lower.spines["bottom"].set_bounds(times_s[0], times_s[-1])
    grid[0, 0].set_ylabel("P(movement)", fontsize=9)
    grid[1, 0].set_ylabel("entropy (bits)", fontsize=9)
    figure.suptitle(f"performing {truth.replace('_', ' ')}", fontsize=10, x=0.01, ha="left")
    return save(figure, path)


def _colours(beliefs: Mapping[str, Floats], labels: Sequence[str], truth: str) -> dict[str, str]:
    """Colours for the true movement and for the movements of the highest mean probability in some column."""
    strength = np.max([belief.mean(axis=0) for belief in beliefs.values()], axis=0)
    order = np.argsort(-strength, kind="stable")
    ranked = [labels[i] for i in order if labels[i] != truth and strength[i] >= WORTH_COLOUR]
    return dict(zip([truth, *ranked[:NAMED]], COLOURS, strict=False))


def _draw_beliefs(
    axes: Axes, times_s: Floats, belief: Floats, labels: Sequence[str], truth: str, colours: Mapping[str, str]
) -> None:
    for label, p in zip(labels, belief.T, strict=True):
        width = 2.6 if label == truth else 1.5 if label in colours else 0.7
        front = 3 if label == truth else 2 if label in colours else 1
        axes.plot(times_s, p, color=colours.get(label, GREY), linewidth=width, zorder=front, solid_capstyle="round")
    axes.set_ylim(-0.02, 1.04)
    span = float(times_s[-1] - times_s[0]) or 1.0
    axes.set_xlim(times_s[0], times_s[-1] + 0.42 * span)
    axes.set_xticks([tick for tick in axes.get_xticks() if times_s[0] <= tick <= times_s[-1]])
    axes.spines["bottom"].set_bounds(times_s[0], times_s[-1])
    _name_lines(axes, times_s, belief, labels, truth, colours)


def _name_lines(
    axes: Axes, times_s: Floats, belief: Floats, labels: Sequence[str], truth: str, colours: Mapping[str, str]
) -> None:
    """Name the true movement, and those that end high enough, at the end of their lines."""
    last = dict(zip(labels, belief[-1].tolist(), strict=True))
    shown = [label for label in colours if label == truth or last[label] >= WORTH_NAMING]
    for label, height in zip(shown, spread([last[label] for label in shown], LABEL_GAP), strict=True):
        axes.annotate(
            label.replace("_", " "),
            (float(times_s[-1]), height),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            color=colours[label],
            fontweight="bold" if label == truth else "normal",
        )


TRUE, RIGHT, WRONG, UNDECIDED = INK, COLOURS[2], COLOURS[1], "#999999"
ROWS_LIMIT = 10
"""Most movements shown: those performed or judged, then the most probable ones."""


class LabelledInterval(NamedTuple):
    """A true movement or a verdict, in seconds."""

    start_s: float
    end_s: float
    label: str


def verdict_timeline_figure(
    times_s: Floats,
    belief: Floats,
    labels: Sequence[str],
    truth: Sequence[LabelledInterval],
    verdicts: Sequence[LabelledInterval],
    path: Path,
    late_s: float = 0.0,
) -> Path:
    """Strips of true movements and verdicts, above the fused posterior (F, M) at times_s (F,) as a map.

    A verdict is right (green) when it overlaps a true span of its label, which counts as `late_s` longer; `abstain` is
    grey; others are orange and hatched. True spans are framed in the map. Returns `path`.
    """
    rows = _rows(belief, labels, truth, verdicts)
    width = float(np.clip(0.35 * (times_s[-1] - times_s[0]), 7, 16))
    figure = Figure(figsize=(width, 1.5 + 0.24 * len(rows)), layout="constrained")
    strips, field = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (2, max(len(rows), 3))})
    for span in truth:
        _box(strips, span, 1, TRUE, hatched=False)
    for span in verdicts:
        colour = UNDECIDED if span.label == ABSTAIN else RIGHT if _is_right(span, truth, late_s) else WRONG
        _box(strips, span, 0, colour, hatched=colour == WRONG)
    strips.set_yticks([0.4, 1.4], ["verdict", "done"], fontsize=8)
    strips.set_ylim(-0.05, 1.95)
    strips.tick_params(bottom=False, left=False)
    strips.spines[:].set_visible(False)
    _map(field, times_s, belief, labels, rows, truth)
    field.set_xlabel("time (s)", fontsize=9)
    field.set_xlim(times_s[0], times_s[-1])
    return save(figure, path)


def _rows(
    belief: Floats, labels: Sequence[str], truth: Sequence[LabelledInterval], verdicts: Sequence[LabelledInterval]
) -> list[str]:
    """The labels to show, in the vocabulary's order."""
    mentioned = {span.label for span in (*truth, *verdicts)}
    peak = belief.max(axis=0)
    ranked = sorted(labels, key=lambda label: (label not in mentioned, -peak[labels.index(label)]))
    chosen = set(ranked[: max(ROWS_LIMIT, len(mentioned))])
    return [label for label in labels if label in chosen]


def _is_right(verdict: LabelledInterval, truth: Sequence[LabelledInterval], late_s: float) -> bool:
    return any(
        verdict.label == true.label and verdict.start_s < true.end_s + late_s and true.start_s < verdict.end_s
        for true in truth
    )


def _box(axes: Axes, span: LabelledInterval, level: int, colour: str, hatched: bool) -> None:
    width = span.end_s - span.start_s
    face = (span.start_s, level)
    axes.add_patch(Rectangle(face, width, 0.8, facecolor=colour, alpha=0.18, linewidth=0))
    axes.add_patch(Rectangle(face, width, 0.8, fill=False, edgecolor=colour, hatch="///" if hatched else None))
    name = span.label.replace("_", " ")
    ground = {"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 1} if hatched else None
    axes.text(span.start_s + width / 2, level + 0.4, name, ha="center", va="center", fontsize=8, color=INK, bbox=ground)


def _map(
    axes: Axes,
    times_s: Floats,
    belief: Floats,
    labels: Sequence[str],
    rows: Sequence[str],
    truth: Sequence[LabelledInterval],
) -> None:
    """The fused posterior as shades, one line per movement, white up to chance; true spans are framed."""
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
