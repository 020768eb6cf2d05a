"""How a movement is done, as four lines of a terminal: Effort and Shape between their poles, and the facing. Pure."""

from collections.abc import Sequence

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from common.facets import EFFORT
from common.messages import JudgementMessage
from hub.bars import Needle, Tug
from hub.leanings import Leaning, facing, leanings

LINES = 4
POLE_CELLS = 10
"""The longest pole is retreating, with ten letters."""
LEAST_WIDTH = 64


def manner_lines(judgement: JudgementMessage | None, width: int) -> RenderableType | None:
    """LINES lines, Effort on the left, Shape and the facing on the right; None where none is said or fits."""
    said = () if judgement is None else leanings(judgement.facets)
    direction = None if judgement is None else facing(judgement.facing_deg)
    if width < LEAST_WIDTH or not (said or direction is not None):
        return None
    effort = [_tug(each) for each in said if each.facet in EFFORT]
    shape = [_tug(each) for each in said if each.facet not in EFFORT]
    needle: list[RenderableType] = [] if direction is None else [Needle(direction)]
    table = Table.grid(expand=True, padding=(0, 2))
    table.add_column(ratio=1)
    table.add_column(ratio=1)
    for left, right in zip(_filled(effort), _filled([*shape, *needle]), strict=True):
        table.add_row(left, right)
    return table


def _filled(rows: Sequence[RenderableType]) -> list[RenderableType]:
    return [*rows, *[""] * (LINES - len(rows))]


def _tug(said: Leaning) -> RenderableType:
    """`sustained ──┼━━ sudden`: the pole that it leans to is written plainly, the other is dim."""
    left, right = said.poles
    row = Table.grid(expand=True, padding=(0, 1))
    row.add_column(width=POLE_CELLS, no_wrap=True, justify="right")
    row.add_column(ratio=1)
    row.add_column(width=POLE_CELLS, no_wrap=True)
    row.add_row(
        Text(left, "" if said.value == left else "dim"),
        Tug(said.lean),
        Text(right, "" if said.value == right else "dim"),
    )
    return row
