"""Rows of several people in one frame: the first person's parts have their usual names, the nth's are NAME@n. Pure."""

from collections.abc import Sequence

import numpy as np

from observer.tracking.person_keeper import Detection
from observer.tracks import Floats

MARK = "@"
TALL_EXTENTS = 1.15
"""A person is so much taller than what is between head and feet; as much shorter parts stand for a whole body."""
LEAST_PARTS = 3
"""Fewer parts are no person."""


def has_several(body_parts: Sequence[str]) -> bool:
    """Whether the parts are of several people."""
    return any(MARK in part for part in body_parts)


def of_people(body_parts: Sequence[str], most: int) -> tuple[str, ...]:
    """The names of these parts of `most` people."""
    return (*body_parts, *(f"{part}{MARK}{n}" for n in range(2, most + 1) for part in body_parts))


def rows_of_people(recorded: Sequence[str]) -> tuple[tuple[str, ...], list[list[int]]]:
    """The parts of one person, and each person's rows of these in a frame; raises KeyError if one lacks a part."""
    parts = tuple(part for part in recorded if MARK not in part)
    numbers = sorted({int(part.partition(MARK)[2]) for part in recorded if MARK in part})
    known = {part: row for row, part in enumerate(recorded)}
    names = [parts, *([f"{part}{MARK}{n}" for part in parts] for n in numbers)]
    return parts, [[known[part] for part in own] for own in names]


def detection_of(centres: Floats, whole: Floats) -> Detection | None:
    """A person whose parts are seen at `centres` (P, 2), NaN where not seen; None if fewer than `LEAST_PARTS` are seen.

    whole: (Q, 2) all parts, also those that are hidden; middle and height of the person follow from them.
    """
    if np.isfinite(centres).all(axis=1).sum() < LEAST_PARTS:
        return None
    u, v = (whole.min(axis=0) + whole.max(axis=0)) / 2
    return Detection(centres, float(u), float(v), TALL_EXTENTS * max(float(np.ptp(whole[:, 1])), 1e-9))
