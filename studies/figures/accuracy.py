"""Figures of accuracy: confusion, earliness, reliability; and the style of all figures.

Colour-blind readers and grey printers can tell the colours apart. Figures use matplotlib's objects and no global state,
so that threads and tests do not interfere.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray

from common.errors import BadInput
from studies.metrics import BINS

__all__ = ["COLOURS", "GREY", "INK", "MARKERS", "Axes", "Figure", "Floats", "plain", "save", "spread"]

Floats = NDArray[np.float64]
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
"""Okabe and Ito's palette without yellow, which is invisible on paper."""
MARKERS = ("o", "s", "^", "D", "v", "P")
"""Series differ in marker as well as in colour."""
INK = "#222222"
GREY = "#BBBBBB"
DOTS_PER_INCH = 150
PICTURE_FORMATS = (".png", ".svg", ".pdf")

RIGHT, WRONG = COLOURS[0], COLOURS[1]
CELL_INCHES = 0.36
PALEST = 0.12
"""Keeps a single confusion in a row of many visible."""


def confusion_figure(confusion: NDArray[np.int64], labels: Sequence[str], title: str, path: Path) -> Path:
    """(M, M) counts, rows true, columns judged -> a picture at `path` (.png, .svg, .pdf), returned.

    Colour is the share of the row, numbers are counts; a row without trials is white.
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


BAR_LABEL_GAP = 0.06


def earliness_figure(
    fractions: Sequence[float], series: Mapping[str, Sequence[float]], path: Path, chance: float | None = None
) -> Path:
    """Accuracies (0 to 1) of each series at `fractions` (0 to 1) of the movement.

    The last series is drawn thick: put fusion last. `chance` is the accuracy of guessing. Returns `path`.
    """
    figure = Figure(figsize=(5.6, 3.6), layout="constrained")
    axes = figure.add_subplot()
    _draw_accuracies(axes, fractions, series)
    if chance is not None:
        axes.axhline(chance, color=GREY, linestyle=":", linewidth=1.2)
        axes.text(fractions[0], chance + 0.01, "guessing", fontsize=8, color="#777777", va="bottom")
    axes.xaxis.set_major_formatter(PercentFormatter(1.0))
    axes.set_xlabel("share of the movement")
    axes.set_ylabel("accuracy")
    return save(figure, path)


def _draw_accuracies(axes: Axes, at: Sequence[float], series: Mapping[str, Sequence[float]]) -> None:
    """A line for each series, named with its last value at its end."""
    heights = spread([accuracies[-1] for accuracies in series.values()], BAR_LABEL_GAP)
    for place, ((name, accuracies), height) in enumerate(zip(series.items(), heights, strict=True)):
        last = place == len(series) - 1
        colour, marker = COLOURS[place % len(COLOURS)], MARKERS[place % len(MARKERS)]
        axes.plot(at, accuracies, color=colour, marker=marker, markersize=5, linewidth=2.6 if last else 1.4)
        axes.annotate(
            f"{name}  {accuracies[-1]:.0%}", (at[-1], height), xytext=(8, 0), textcoords="offset points",
            va="center", fontsize=9, color=colour, fontweight="bold" if last else "normal",
        )  # fmt: skip
    width = (at[-1] - at[0]) or 1
    axes.set_xticks(list(at))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.set_xlim(at[0] - 0.06 * width, at[-1] + 0.46 * width)
    axes.set_ylim(0, 1.02)
    axes.grid(axis="y", color="#E5E5E5", linewidth=0.7)
    axes.set_axisbelow(True)
    plain(axes)
    axes.spines["bottom"].set_bounds(at[0], at[-1])


FEWEST = 5
"""Bins with fewer judgements are hollow and off the line, because their height is mostly random."""


def reliability_figure(
    series: Mapping[str, tuple[Floats, NDArray[np.bool_]]], ece: Mapping[str, float], path: Path, bins: int = BINS
) -> Path:
    """Reliability diagram: for each series (confidence (N,) in 0..1, correct (N,)) above; counts below.

    `ece` is each series' expected calibration error, shown in the legend. On the dotted line confidence equals
    accuracy; below it an observer is too confident. Returns `path`.
    """
    figure = Figure(figsize=(4.4, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (3, 1)})
    upper.plot([0, 1], [0, 1], color=GREY, linestyle=":", linewidth=1.4)
    upper.text(0.97, 0.05, "overconfident", fontsize=8, color="#777777", ha="right")
    upper.text(0.03, 0.93, "underconfident", fontsize=8, color="#777777")
    edges = np.linspace(0, 1, bins + 1)
    for place, (name, (confidence, correct)) in enumerate(series.items()):
        colour, marker = COLOURS[place % len(COLOURS)], MARKERS[place % len(MARKERS)]
        counts = np.histogram(confidence, edges)[0]
        _curve(upper, edges, confidence, correct, colour, marker, f"{name}, ECE {ece[name]:.2f}")
        lower.stairs(counts, edges, color=colour, linewidth=1.6)
    upper.set_xlim(-0.02, 1.02)
    upper.set_ylim(-0.02, 1.04)
    upper.set_ylabel("accuracy", fontsize=9)
    lower.set_ylabel("judgements", fontsize=9)
    lower.set_xlabel("confidence", fontsize=9)
    figure.legend(frameon=False, fontsize=9, loc="outside upper left", ncols=min(2, len(series)))
    plain(upper)
    plain(lower)
    return save(figure, path)


def _curve(
    axes: Axes, edges: Floats, confidence: Floats, correct: NDArray[np.bool_], colour: str, marker: str, name: str
) -> None:
    """One series: each non-empty bin at its mean confidence and its accuracy."""
    place = np.clip(np.digitize(confidence, edges) - 1, 0, len(edges) - 2)
    counts = np.bincount(place, minlength=len(edges) - 1)
    filled = counts > 0
    x = np.bincount(place, confidence, len(counts))[filled] / counts[filled]
    y = np.bincount(place, correct, len(counts))[filled] / counts[filled]
    few = counts[filled] < FEWEST
    axes.plot(x[~few], y[~few], color=colour, linewidth=1.6, marker=marker, markersize=5, label=name)
    axes.plot(x[few], y[few], ls="", color=colour, marker=marker, markersize=5, mfc="white")


def plain(axes: Axes) -> None:
    """Remove the upper and the right border."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)


def save(figure: Figure, path: Path) -> Path:
    """Write the format of the suffix (PICTURE_FORMATS), the same bytes for the same figure; returns `path`.

    Makes folders as needed. Raises BadInput for another suffix.
    """
    if path.suffix not in PICTURE_FORMATS:
        raise BadInput(f"figure {str(path)!r}: unknown kind {path.suffix!r}; known: {', '.join(PICTURE_FORMATS)}")
    path.parent.mkdir(parents=True, exist_ok=True)
    dated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix)
    with rc_context({"svg.hashsalt": "labanmesh"}):
        figure.savefig(path, dpi=DOTS_PER_INCH, metadata=dated)
    return path


def spread(heights: Sequence[float], gap: float, top: float = 1.0) -> list[float]:
    """Heights for labels near `heights`, at least `gap` apart, in the same order, none above `top`."""
    placed = [0.0] * len(heights)
    ceiling = top
    for place in sorted(range(len(heights)), key=lambda i: -heights[i]):
        placed[place] = min(heights[place], ceiling)
        ceiling = placed[place] - gap
    lift = max(0.0, -min(placed, default=0.0))
    return [height + lift for height in placed]
