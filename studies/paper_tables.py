"""Tables I to III of the paper (section V.B) as data, to be printed beside ours.

The counts are copied as printed. What is printed does not agree with itself in one place: in Table III the
row Point sums to 13 trials where Tables I and II have 12, so its counts sum to 96 while its last row says 95.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MOVEMENTS = ("lunging", "maestro", "stretch", "ok", "point", "byebye", "shake", "nthrow")
"""The paper's eight movements in the order of its tables."""


@dataclass(frozen=True, slots=True)
class PaperTable:
    """One table: `counts` are rows true, columns judged; the other figures are those printed, not computed."""

    title: str
    counts: tuple[tuple[int, ...], ...]
    printed_row_errors: tuple[int, ...]
    printed_errors: int
    printed_rate: float
    printed_trials: int = 95

    @property
    def confusion(self) -> NDArray[np.int64]:
        """(8, 8) counts."""
        return np.array(self.counts, dtype=np.int64)


TABLE_I = PaperTable(
    "Table I: Door plane",
    (
        (7, 0, 0, 5, 0, 0, 0, 1),
        (0, 5, 0, 0, 0, 8, 0, 0),
        (0, 0, 12, 0, 0, 0, 1, 0),
        (0, 0, 0, 7, 1, 0, 5, 0),
        (0, 0, 0, 1, 10, 0, 1, 0),
        (0, 0, 0, 0, 0, 13, 0, 0),
        (0, 0, 0, 4, 0, 0, 9, 0),
        (0, 0, 0, 4, 0, 0, 1, 0),
    ),
    (6, 8, 1, 6, 2, 0, 4, 5),
    32,
    0.66,
)
TABLE_II = PaperTable(
    "Table II: learned in the Door plane, seen from 45 degrees",
    (
        (10, 0, 0, 1, 2, 0, 0, 0),
        (0, 1, 0, 0, 0, 12, 0, 0),
        (0, 0, 7, 2, 0, 0, 4, 0),
        (0, 0, 0, 1, 10, 0, 2, 0),
        (0, 0, 0, 2, 10, 0, 0, 0),
        (0, 0, 0, 0, 0, 13, 0, 0),
        (0, 0, 0, 3, 2, 2, 6, 0),
        (0, 0, 0, 0, 0, 0, 5, 0),
    ),
    (3, 12, 6, 12, 2, 0, 7, 5),
    47,
    0.51,
)
TABLE_III = PaperTable(
    "Table III: Door and Wheel planes fused",
    (
        (11, 0, 1, 1, 0, 0, 0, 0),
        (0, 11, 0, 0, 0, 2, 0, 0),
        (0, 0, 12, 0, 1, 0, 0, 0),
        (0, 0, 0, 7, 2, 0, 4, 0),
        (0, 0, 0, 1, 11, 0, 1, 0),
        (0, 0, 0, 0, 0, 13, 0, 0),
        (0, 0, 0, 3, 1, 1, 8, 0),
        (0, 0, 0, 0, 0, 0, 0, 5),
    ),
    (2, 2, 1, 6, 2, 0, 5, 0),
    18,
    0.81,
)
