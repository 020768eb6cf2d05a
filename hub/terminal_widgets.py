"""Building blocks of the terminal view: rows that fill the width, and bars with a plain ASCII form. Pure."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.measure import Measurement
from rich.segment import Segment
from rich.style import Style
from rich.table import Table

MIN_CELLS = 4


def grid(rows: Iterable[Sequence[RenderableType]], *columns: Mapping[str, Any], padding: int = 0) -> Table:
    """Rows side by side over the whole width. columns: the arguments of rich's Table.add_column for each."""
    table = Table.grid(expand=True, padding=(0, padding))
    for column in columns:
        table.add_column(**column)
    for row in rows:
        table.add_row(*row)
    return table


@dataclass(frozen=True, slots=True)
class ShareBar:
    """A rich renderable: `share` (0 to 1) of the width drawn in `style`, the rest as a dim track."""

    share: float
    style: str = "cyan"

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        return Measurement(min(MIN_CELLS, options.max_width), options.max_width)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        width = options.max_width
        halves = round(min(1.0, max(0.0, self.share)) * width * 2)
        full, half, track = ("#", "", ".") if options.ascii_only else ("━", "╸", "─")
        drawn = full * (halves // 2) + half * (halves % 2)
        yield Segment(drawn, console.get_style(self.style))
        yield Segment(track * (width - len(drawn)), Style(dim=True))
