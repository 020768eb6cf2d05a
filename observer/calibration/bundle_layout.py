"""Where each unknown of the bundle adjustment stands in its vector, and the sparse slopes by it."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from observer.geometry.projection import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Whole = NDArray[np.intp]

POSE, LENS, BACK = 6, 5, 4
"""Unknowns of a place (rotation vector, translation), of a lens (f, cu, cv, k1, k2), of the board's back."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Cameras, boards, lenses, moments, back; one after the other. cameras, boards, lenses: their names, in order."""

    cameras: tuple[str, ...]
    boards: tuple[int, ...]
    lenses: tuple[str, ...]
    sightings: int
    _starts: dict[str | int, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        # Names are texts and numbers are numbers, so that one table holds both.
        starts = {key: POSE * n for n, key in enumerate([*self.cameras, *self.boards])}
        object.__setattr__(self, "_starts", starts)

    def camera(self, name: str) -> slice:
        """Where a camera's place is."""
        return slice(self._starts[name], self._starts[name] + POSE)

    def board(self, number: int) -> slice:
        """Where the place of the board in this picture is."""
        return slice(self._starts[number], self._starts[number] + POSE)

    def lens(self, name: str) -> slice:
        """Where a camera's lens is."""
        start = POSE * (len(self.cameras) + len(self.boards)) + LENS * self.lenses.index(name)
        return slice(start, start + LENS)

    @property
    def moments(self) -> slice:
        """Where the moment of each sighting is."""
        start = POSE * (len(self.cameras) + len(self.boards)) + LENS * len(self.lenses)
        return slice(start, start + self.sightings)

    @property
    def back(self) -> slice:
        """Where the place of the pattern on the board's back is."""
        return slice(self.moments.stop, self.moments.stop + BACK)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.back.stop)


class Blocks:
    """A sparse matrix of slopes, filled block by block from the top. columns: number of unknowns."""

    def __init__(self, columns: int) -> None:
        self._columns, self._top, self._bottom = columns, 0, 0
        self._parts: list[tuple[Whole, Whole, Floats]] = []

    def begin(self, rows: int) -> None:
        """What is added next stands in the next so many rows."""
        self._top, self._bottom = self._bottom, self._bottom + rows

    def add(self, columns: slice, slopes: Floats) -> None:
        """(rows, width) slopes by these unknowns."""
        rows, across = np.mgrid[self._top : self._bottom, columns.start : columns.stop]
        self._parts.append((rows.ravel(), across.ravel(), slopes.ravel()))

    def add_diagonal(self, columns: Whole, slopes: Floats) -> None:
        """One row for each of these unknowns."""
        self.begin(len(columns))
        self._parts.append((np.arange(self._top, self._bottom), columns, slopes))

    def matrix(self) -> "csr_array[np.float64]":
        """The scipy.sparse matrix (rows, unknowns)."""
        from scipy.sparse import csr_array

        rows, columns, values = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        return csr_array((values, (rows, columns)), shape=(self._bottom, self._columns))
