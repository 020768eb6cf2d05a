"""How often the poles of each Effort factor are told apart, by each view and fused."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from studies.figures.style import COLOURS, GREY, Figure, plain, save

CHANCE = 0.5
HATCHES = ("", "//", "..", "xx", "\\\\", "++")
"""Colour is never alone: bars differ in their hatching as well."""


def poles_figure(factors: Sequence[str], rates: Mapping[str, Sequence[float]], path: Path) -> Path:
    """Bars: for each factor the share of right judgements, one bar a series (a view, or fused). Returns `path`.

    rates: for each series one rate a factor, 0 to 1. The dotted line is chance: there are two poles.
    """
    figure = Figure(figsize=(5.0, 3.2), layout="constrained")
    axes = figure.subplots()
    width = 0.8 / len(rates)
    for place, (name, values) in enumerate(rates.items()):
        at = np.arange(len(factors)) + (place - (len(rates) - 1) / 2) * width
        colour, hatch = COLOURS[place % len(COLOURS)], HATCHES[place % len(HATCHES)]
        bars = axes.bar(at, values, width * 0.92, label=name, color=colour, hatch=hatch, edgecolor="white")
        axes.bar_label(bars, [f"{value:.2f}" for value in values], fontsize=7, padding=1)
    axes.axhline(CHANCE, color=GREY, linestyle=":", linewidth=1.4)
    axes.set_xticks(range(len(factors)), factors, fontsize=9)
    axes.set_ylim(0, 1.08)
    axes.set_ylabel("right", fontsize=9)
    figure.legend(frameon=False, fontsize=9, loc="outside upper left", ncols=len(rates))
    plain(axes)
    return save(figure, path)
