"""Learning curves: accuracy against how many people, or how many recordings of each, were learned from."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.ticker import PercentFormatter

from studies.figures.style import COLOURS, MARKERS, Axes, Figure, plain, save, spread

LABEL_GAP = 0.06
Panel = tuple[Sequence[int], Mapping[str, Sequence[float]], Sequence[tuple[float, float]]]


def learning_figure(panels: Mapping[str, Panel], path: Path) -> Path:
    """One panel a title: numbers learned from, accuracies (0 to 1) of each series, and least and most of the last one.

    Put the fusion last: it is drawn thick, and shaded from least to most. Returns `path`.
    """
    figure = Figure(figsize=(4.2 * len(panels), 3.4), layout="constrained")
    drawn = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axes, (title, panel) in zip(drawn, panels.items(), strict=True):
        _draw(axes, panel)
        axes.set_xlabel(title)
    drawn[0].set_ylabel("right judgements at the end")
    return save(figure, path)


def _draw(axes: Axes, panel: Panel) -> None:
    numbers, series, ranges = panel
    heights = spread([values[-1] for values in series.values()], LABEL_GAP)
    for place, ((name, values), height) in enumerate(zip(series.items(), heights, strict=True)):
        last = place == len(series) - 1
        colour, marker = COLOURS[place % len(COLOURS)], MARKERS[place % len(MARKERS)]
        axes.plot(numbers, values, color=colour, marker=marker, markersize=5, linewidth=2.6 if last else 1.4)
        axes.annotate(
            f"{name}  {values[-1]:.0%}", (numbers[-1], height), xytext=(8, 0), textcoords="offset points",
            va="center", fontsize=8, color=colour, fontweight="bold" if last else "normal",
        )  # fmt: skip
        if last:
            least, most = [pair[0] for pair in ranges], [pair[1] for pair in ranges]
            axes.fill_between(numbers, least, most, color=colour, alpha=0.15, linewidth=0)
    axes.set_xticks(list(numbers))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    width = max(numbers[-1] - numbers[0], 1)
    axes.set_xlim(numbers[0] - 0.06 * width, numbers[-1] + 0.4 * width)
    axes.set_ylim(0, 1.02)
    axes.grid(axis="y", color="#E5E5E5", linewidth=0.7)
    axes.set_axisbelow(True)
    plain(axes)
    axes.spines["bottom"].set_bounds(numbers[0], numbers[-1])
