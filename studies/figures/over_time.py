"""Belief and entropy over time: the paper's Fig. 7."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from studies.figures.accuracy import COLOURS, GREY, Axes, Figure, Floats, plain, save, spread

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
