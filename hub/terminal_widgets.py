"""Building blocks of the terminal view: bars that fill their width, and how a movement is done as four lines. Pure.

All of them have a plain ASCII form for terminals without more.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.measure import Measurement
from rich.segment import Segment
from rich.style import Style
from rich.table import Table
from rich.text import Text

from common.facets import EFFORT
from common.messages import JudgementMessage
from hub.wording import Leaning, facing, facing_words, leanings

MIN_CELLS = 4
ARROWS = "↑↖←↙↓↘→↗"
"""By eighths of a turn to the left; up is the front."""
MANNER_LINES = 4
POLE_CELLS = 10
"""The longest pole is "retreating", with ten letters."""
MANNER_MIN_WIDTH = 64


def grid(rows: Iterable[Sequence[RenderableType]], *columns: Mapping[str, Any], padding: int = 0) -> Table:
    """Rows side by side over the whole width. columns: the arguments of rich's Table.add_column for each."""
    table = Table.grid(expand=True, padding=(0, padding))
    for column in columns:
        table.add_column(**column)
    for row in rows:
        table.add_row(*row)
    return table


class _Flexible:
    """A renderable of any width from MIN_CELLS up to all there is."""

    __slots__ = ()

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        """The least and the greatest width."""
        return Measurement(min(MIN_CELLS, options.max_width), options.max_width)


@dataclass(frozen=True, slots=True)
class ShareBar(_Flexible):
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


@dataclass(frozen=True, slots=True)
class LeanBar(_Flexible):
    """A rich renderable: a bar from the middle, to the left for a `lean` below 0 and to the right above."""

    lean: float
    style: str = "cyan"

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        """The segments of one line, `options.max_width` cells wide."""
        half = (options.max_width - 1) // 2
        drawn = round(min(1.0, abs(self.lean)) * half)
        full, middle, track = ("#", "|", ".") if options.ascii_only else ("━", "┼", "─")
        left, right = (drawn, 0) if self.lean < 0 else (0, drawn)
        style, dim = console.get_style(self.style), Style(dim=True)
        yield Segment(track * (half - left), dim)
        yield Segment(full * left, style)
        yield Segment(middle, dim)
        yield Segment(full * right, style)
        yield Segment(track * (half - right), dim)


@dataclass(frozen=True, slots=True)
class FacingLine:
    """A rich renderable: which way the person faces, as an arrow seen from above and in words."""

    facing_deg: float

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Text]:
        """One line."""
        arrow = "" if options.ascii_only else f"{ARROWS[round(self.facing_deg / 45) % 8]} "
        words = facing_words(self.facing_deg, " deg" if options.ascii_only else "°")
        yield Text.assemble(("facing ", "dim"), arrow, words, no_wrap=True, overflow="ellipsis")


def manner_table(judgement: JudgementMessage | None, width: int) -> RenderableType | None:
    """MANNER_LINES lines, Effort left, Shape and the facing right; None if nothing is known or it does not fit."""
    facets = () if judgement is None else leanings(judgement.facets)
    direction = None if judgement is None else facing(judgement.facing_deg)
    if width < MANNER_MIN_WIDTH or not (facets or direction is not None):
        return None
    left: list[RenderableType] = [_facet_row(each) for each in facets if each.facet in EFFORT]
    right: list[RenderableType] = [_facet_row(each) for each in facets if each.facet not in EFFORT]
    right += [] if direction is None else [FacingLine(direction)]
    filled = ([*rows, *[""] * (MANNER_LINES - len(rows))] for rows in (left, right))
    return grid(zip(*filled, strict=True), {"ratio": 1}, {"ratio": 1}, padding=2)


def _facet_row(leaning: Leaning) -> RenderableType:
    """`sustained ──┼━━ sudden`: the likeliest pole is plain, the other is dim."""
    left, right = leaning.poles
    first, second = (Text(pole, "" if leaning.value == pole else "dim") for pole in (left, right))
    pole = {"width": POLE_CELLS, "no_wrap": True}
    columns = ({**pole, "justify": "right"}, {"ratio": 1}, pole)
    return grid([(first, LeanBar(leaning.lean), second)], *columns, padding=1)
