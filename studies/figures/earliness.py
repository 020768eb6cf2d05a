"""How early the judgement is right: accuracy against the part of the movement that has been seen."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.ticker import PercentFormatter

from studies.figures.style import COLOURS, GREY, MARKERS, Figure, plain, save, spread

LABEL_GAP = 0.06


def earliness_figure(
    fractions: Sequence[float], series: Mapping[str, Sequence[float]], path: Path, chance: float | None = None
) -> Path:
    """Accuracies (0 to 1) of each series at `fractions` (0 to 1) of the movement; the last series is drawn thick.

    Put the fusion last. `chance` draws the accuracy of guessing. Returns `path`.
    """
    figure = Figure(figsize=(5.6, 3.6), layout="constrained")
    axes = figure.add_subplot()
    heights = spread([accuracies[-1] for accuracies in series.values()], LABEL_GAP)
    for place, ((name, accuracies), height) in enumerate(zip(series.items(), heights, strict=True)):
        last = place == len(series) - 1
        colour = COLOURS[place % len(COLOURS)]
        marker = MARKERS[place % len(MARKERS)]
        axes.plot(fractions, accuracies, color=colour, marker=marker, markersize=5, linewidth=2.6 if last else 1.4)
        axes.annotate(
            f"{name}  {accuracies[-1]:.0%}", (fractions[-1], height), xytext=(8, 0), textcoords="offset points",
            va="center", fontsize=9, color=colour, fontweight="bold" if last else "normal",
        )  # fmt: skip
    if chance is not None:
        axes.axhline(chance, color=GREY, linestyle=":", linewidth=1.2)
        axes.text(fractions[0], chance + 0.01, "guessing", fontsize=8, color="#777777", va="bottom")
    axes.set_xticks(list(fractions))
    axes.xaxis.set_major_formatter(PercentFormatter(1.0))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.set_xlim(min(fractions) - 0.03, max(fractions) * 1.38)
    axes.set_ylim(0, 1.02)
    axes.grid(axis="y", color="#E5E5E5", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.set_xlabel("part of the movement seen")
    axes.set_ylabel("right judgements")
    plain(axes)
    axes.spines["bottom"].set_bounds(min(fractions), max(fractions))
    return save(figure, path)
