"""Shared by all figures: colours that also colour-blind readers and grey printers can tell apart, and saving.

Figures use matplotlib's objects and no global state, so that threads and tests do not interfere.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from common.errors import BadInput

__all__ = ["COLOURS", "DOTS_PER_INCH", "GREY", "INK", "MARKERS", "Axes", "Figure", "Floats", "plain", "save", "spread"]

Floats = NDArray[np.float64]
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
"""Okabe and Ito's palette without yellow, which is invisible on paper."""
MARKERS = ("o", "s", "^", "D", "v", "P")
"""Series differ in marker as well as in colour."""
INK = "#222222"
GREY = "#BBBBBB"
DOTS_PER_INCH = 150
FORMATS = (".png", ".svg", ".pdf")


def plain(axes: Axes) -> None:
    """Remove the upper and the right border."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)


def save(figure: Figure, path: Path) -> Path:
    """Write the format of the suffix (FORMATS), the same bytes for the same figure; returns `path`.

    Makes folders as needed. Raises BadInput for another suffix.
    """
    if path.suffix not in FORMATS:
        raise BadInput(f"figure {str(path)!r}: unknown kind {path.suffix!r}; known: {', '.join(FORMATS)}")
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
