"""The confusion table as a picture: right judgements blue, confusions orange, as dark as they are frequent."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from studies.figures.style import COLOURS, INK, Axes, Figure, Floats, save

RIGHT, WRONG = COLOURS[0], COLOURS[1]
CELL_INCHES = 0.36
PALEST = 0.12
"""A single confusion in a row of many is still to be seen."""


def confusion_figure(confusion: NDArray[np.int64], labels: Sequence[str], title: str, path: Path) -> Path:
    """(M, M) counts, rows true, columns judged -> a picture at `path` (.png, .svg, .pdf), which is returned.

    Colour is the share of the row; the numbers are counts; a row without trials stays white.
    """
    size = len(labels)
    side = size * CELL_INCHES + 1.9
    figure = Figure(figsize=(side, side + 0.3), layout="constrained")
    axes = figure.add_subplot()
    shares = confusion / np.maximum(confusion.sum(axis=1, keepdims=True), 1)
    axes.imshow(_colours(shares), aspect="equal")
    _write_counts(axes, confusion, shares)
    names = [label.replace("_", " ") for label in labels]
    axes.set_xticks(range(size), names, rotation=45, ha="right", rotation_mode="anchor", fontsize=8)
    axes.set_yticks(range(size), names, fontsize=8)
    axes.set_xlabel("judged")
    axes.set_ylabel("true")
    axes.set_xticks(np.arange(size + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(size + 1) - 0.5, minor=True)
    axes.grid(which="minor", color="#DDDDDD", linewidth=0.6)
    axes.tick_params(which="both", length=0)
    axes.spines[:].set_visible(False)
    right, trials = int(confusion.trace()), int(confusion.sum())
    axes.set_title(f"{title}\n{right} of {trials} right ({right / max(trials, 1):.0%})", fontsize=10, loc="left")
    return save(figure, path)


def _colours(shares: Floats) -> Floats:
    """(M, M) shares of the row -> (M, M, 3) colours, white at zero."""
    strength = np.where(shares > 0, PALEST + (1 - PALEST) * shares, 0.0)[..., None]
    hue = np.where(np.eye(len(shares), dtype=bool)[..., None], to_rgb(RIGHT), to_rgb(WRONG))
    colours: Floats = 1 - strength * (1 - hue)
    return colours


def _write_counts(axes: Axes, confusion: NDArray[np.int64], shares: Floats) -> None:
    for row, column in np.argwhere(confusion > 0).tolist():
        colour = "white" if shares[row, column] > 0.55 else INK
        weight = "bold" if row == column else "normal"
        count = str(confusion[row, column])
        axes.text(column, row, count, ha="center", va="center", fontsize=8, color=colour, fontweight=weight)
