"""Where an observer sees a person on the floor of the room, as posteriors carry it (docs/design/people.md); and the
assignment of a few rows to a few columns at the least total cost, by which persons are told apart. Pure.
"""

import math
from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta, Struct


def best_matching(costs: Sequence[Sequence[float]], alone: float) -> tuple[float, dict[int, int]]:
    """The least total cost, and row -> column of its matching, where a row without a column costs `alone`.

    costs: (R, C); there are at most four of each, so that all matchings can be tried.
    """

    def best(row: int, free: frozenset[int]) -> tuple[float, tuple[tuple[int, int], ...]]:
        if row == len(costs):
            return 0.0, ()
        total, pairs = best(row + 1, free)
        result = total + alone, pairs
        for column in sorted(free):
            if costs[row][column] < alone:
                total, pairs = best(row + 1, free - {column})
                if total + costs[row][column] < result[0]:
                    result = total + costs[row][column], ((row, column), *pairs)
        return result

    total, pairs = best(0, frozenset(range(len(costs[0]) if costs else 0)))
    return total, dict(pairs)


FARTHEST_M, WIDEST_M2 = 10_000.0, 1e8
PERSON_GATE = 9.21
"""Squared Mahalanobis distance within which two places may be one person's: the 99th percentile of chi² with two
degrees of freedom (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section
3.7)."""
BODY_SPREAD_M = 0.2
"""Standard deviation of where two cameras see one person, beside what each states: half the width of a body."""
KEEP = 3.0
"""Nats by which another person must fit better: odds of 20."""
_Metres = Annotated[float, Meta(ge=-FARTHEST_M, le=FARTHEST_M)]
_Metres2 = Annotated[float, Meta(ge=-WIDEST_M2, le=WIDEST_M2)]


class FloorPlace(Struct, frozen=True, kw_only=True, gc=False):
    """A Gaussian on the floor, in the axes of the camera files. at: x, z in metres. covariance: xx, xz, zz in m².

    Raises ValueError for a value that is not finite, and for a covariance that is not positive definite.
    """

    at: tuple[_Metres, _Metres]
    covariance: tuple[_Metres2, _Metres2, _Metres2]

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.at, *self.covariance))):
            raise ValueError("place has a value that is not finite")
        xx, xz, zz = self.covariance
        if xx <= 0.0 or zz <= 0.0 or xx * zz - xz * xz <= 0.0:
            raise ValueError("the covariance of place is not positive definite")

    def distance(self, other: "FloorPlace") -> float:
        """Half the squared Mahalanobis distance of another camera's sight, nats."""
        (x, z), (other_x, other_z) = self.at, other.at
        spread = 2 * BODY_SPREAD_M**2
        xx, xz, zz = (own + others for own, others in zip(self.covariance, other.covariance, strict=True))
        xx, zz, x, z = xx + spread, zz + spread, x - other_x, z - other_z
        return (zz * x * x - 2 * xz * x * z + xx * z * z) / (xx * zz - xz * xz) / 2
