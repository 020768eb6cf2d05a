"""Bars that fill the width they are given, in half-cell steps, and in plain ASCII where the terminal has no more."""

from collections.abc import Iterator
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions
from rich.measure import Measurement
from rich.segment import Segment
from rich.style import Style

LEAST_CELLS = 4


@dataclass(frozen=True, slots=True)
class Bar:
    """A rich renderable: `share` (0 to 1) of the width drawn in `style`, the rest as a dim track."""

    share: float
    style: str = "cyan"

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        """The segments of one line, `options.max_width` cells wide."""
        width = options.max_width
        halves = round(min(1.0, max(0.0, self.share)) * width * 2)
        full, half, track = ("#", "", ".") if options.ascii_only else ("━", "╸", "─")
        drawn = full * (halves // 2) + half * (halves % 2)
        yield Segment(drawn, console.get_style(self.style))
        yield Segment(track * (width - len(drawn)), Style(dim=True))

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        """Any width from LEAST_CELLS up to all there is."""
        return Measurement(min(LEAST_CELLS, options.max_width), options.max_width)
