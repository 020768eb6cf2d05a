"""Where an observer sees a person on the floor of the room, as posteriors carry it (docs/design/people.md). Pure."""

import math
from typing import Annotated

from msgspec import Meta, Struct

FARTHEST_M, WIDEST_M2 = 10_000.0, 1e8
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
