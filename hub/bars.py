"""Bars that fill the width they are given, and a needle; in plain ASCII where the terminal has no more."""

from collections.abc import Iterator
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions
from rich.measure import Measurement
from rich.segment import Segment
from rich.style import Style
from rich.text import Text

from hub.leanings import facing_words

LEAST_CELLS = 4
ARROWS = "↑↖←↙↓↘→↗"
"""By eighths of a turn to the left; up is the front."""


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


@dataclass(frozen=True, slots=True)
class Tug:
    """A rich renderable: a bar that grows from the middle, to the left for a `lean` below 0, to the right above."""

    lean: float
    style: str = "cyan"

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        """The segments of one line, `options.max_width` cells wide."""
        half = (options.max_width - 1) // 2
        drawn = round(min(1.0, abs(self.lean)) * half)
        full, middle, track = ("#", "|", ".") if options.ascii_only else ("━", "┼", "─")
        left, right = (drawn, 0) if self.lean < 0 else (0, drawn)
        pull, dim = console.get_style(self.style), Style(dim=True)
        yield Segment(track * (half - left), dim)
        yield Segment(full * left, pull)
        yield Segment(middle, dim)
        yield Segment(full * right, pull)
        yield Segment(track * (half - right), dim)

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        """Any width from LEAST_CELLS up to all there is."""
        return Measurement(min(LEAST_CELLS, options.max_width), options.max_width)


@dataclass(frozen=True, slots=True)
class Needle:
    """A rich renderable: which way the person faces, as an arrow seen from above and in words."""

    facing_deg: float

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Text]:
        """One line."""
        arrow = "" if options.ascii_only else f"{ARROWS[round(self.facing_deg / 45) % 8]} "
        words = facing_words(self.facing_deg, " deg" if options.ascii_only else "°")
        yield Text.assemble(("facing ", "dim"), arrow, words, no_wrap=True, overflow="ellipsis")
