"""Does a judge mean what it says: how often it was right against how sure it was."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from studies.figures.style import COLOURS, GREY, MARKERS, Axes, Figure, Floats, plain, save

BINS = 15
FEWEST = 5
"""Bins with fewer judgements are drawn hollow and off the line: their height is mostly chance."""


def reliability_figure(
    series: Mapping[str, tuple[Floats, NDArray[np.bool_]]], ece: Mapping[str, float], path: Path, bins: int = BINS
) -> Path:
    """Reliability diagram: for each series (confidence (N,) in 0..1, correct (N,)), above; how many, below.

    `ece` is each series' expected calibration error, told in the legend. On the dotted line confidence is
    what it claims to be; below it a judge is too sure. Returns `path`.
    """
    figure = Figure(figsize=(4.4, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (3, 1)})
    upper.plot([0, 1], [0, 1], color=GREY, linestyle=":", linewidth=1.4)
    upper.text(0.97, 0.05, "too sure", fontsize=8, color="#777777", ha="right")
    upper.text(0.03, 0.93, "too shy", fontsize=8, color="#777777")
    edges = np.linspace(0, 1, bins + 1)
    for place, (name, (confidence, correct)) in enumerate(series.items()):
        colour, marker = COLOURS[place % len(COLOURS)], MARKERS[place % len(MARKERS)]
        counts = np.histogram(confidence, edges)[0]
        _curve(upper, edges, confidence, correct, colour, marker, f"{name}, ECE {ece[name]:.2f}")
        lower.stairs(counts, edges, color=colour, linewidth=1.6)
    upper.set_xlim(-0.02, 1.02)
    upper.set_ylim(-0.02, 1.04)
    upper.set_ylabel("right", fontsize=9)
    lower.set_ylabel("judgements", fontsize=9)
    lower.set_xlabel("confidence", fontsize=9)
    figure.legend(frameon=False, fontsize=9, loc="outside upper left", ncols=min(2, len(series)))
    plain(upper)
    plain(lower)
    return save(figure, path)


def _curve(
    axes: Axes,
    edges: Floats,
    confidence: Floats,
    correct: NDArray[np.bool_],
    colour: str,
    marker: str,
    name: str,
) -> None:
    """One series: each bin that holds anything at its mean confidence and its share of right judgements."""
    place = np.clip(np.digitize(confidence, edges) - 1, 0, len(edges) - 2)
    counts = np.bincount(place, minlength=len(edges) - 1)
    held = counts > 0
    x = np.bincount(place, confidence, len(counts))[held] / counts[held]
    y = np.bincount(place, correct, len(counts))[held] / counts[held]
    few = counts[held] < FEWEST
    axes.plot(x[~few], y[~few], color=colour, linewidth=1.6, marker=marker, markersize=5, label=name)
    axes.plot(x[few], y[few], ls="", color=colour, marker=marker, markersize=5, mfc="white")
