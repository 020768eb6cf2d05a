"""Which body parts of a camera's own tracks a model learns from. Pure.

A pose model finds fifteen parts. Few takes do not tell which of them matter, and each one more makes it harder to learn
from them (docs/results/few-examples.md): hands and head, and the feet where a movement is one of the feet.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from observer.motion.archive import MotionArchive, Recording, movements_in
from observer.tracks import BODY_PARTS, WHOLE_BODY, Floats

SHOWN = 0.5
"""A part is learned if it is seen in this share of the frames of each movement's takes."""
AUTO = "auto"
"""In place of names of parts: `parts_to_learn`."""
FEET = ("left_foot", "right_foot")
MOVED = 0.15
"""A foot moves in a take if it goes so far from the head, as a share of the distance between the farthest parts."""
MOST, LEAST = 95, 5
"""Percentiles of places between which a part has moved: trackers err in single frames."""


def parts_to_learn(archive: MotionArchive) -> tuple[str, ...]:
    """The parts that a model of these tracks reads, in their order; all parts if fewer than two remain.

    Hands, head and parts that are not of the body, and a foot that moves in half of the takes of a movement; each only
    if it is seen in SHOWN of every movement. A part that the camera does not see, such as a foot behind a sofa, is no
    evidence, and a tracker's guesses of it mislead.
    """
    takes: dict[str, list[Recording]] = {}
    for recording in movements_in(archive):
        if recording.label:
            takes.setdefault(recording.label, []).append(recording)
    shares = [np.mean([_visible(take).mean(axis=0) for take in shown], axis=0) for shown in takes.values()]
    least = np.min(shares, axis=0) if shares else np.ones(len(archive.body_parts))
    parts = [part for part, share in zip(archive.body_parts, least, strict=True) if share >= SHOWN]
    always = [part for part in parts if part in BODY_PARTS or part not in WHOLE_BODY]
    if len(always) > 1:
        moved = {part for part in FEET if part in parts and _is_moved(part, archive.body_parts, takes.values())}
        parts = [part for part in parts if part in always or part in moved]
    return tuple(parts) if len(parts) > 1 else archive.body_parts


def _visible(take: Recording) -> Floats:
    """(F, P) 1 where a part is seen, else 0."""
    visible: Floats = np.isfinite(take.positions).prod(axis=2).astype(np.float64)
    return visible


def _is_moved(part: str, body_parts: Sequence[str], movements: Iterable[Sequence[Recording]]) -> bool:
    return any(np.mean([_way(part, body_parts, take) > MOVED for take in takes]) >= 0.5 for takes in movements)


def _way(part: str, body_parts: Sequence[str], take: Recording) -> float:
    """How far the part goes from the head in a take; 0 where that is not known."""
    if "head" not in body_parts:
        return 0.0
    places = take.positions.astype(np.float64)
    away = places[:, body_parts.index(part)] - places[:, body_parts.index("head")]
    away = away[np.isfinite(away).all(axis=1)]
    middles = np.array(
        [
            np.median(one[np.isfinite(one).all(axis=1)], axis=0)
            for one in np.moveaxis(places, 1, 0)
            if np.isfinite(one).all(axis=1).any()
        ]
    )
    size = float(np.ptp(middles, axis=0).max()) if len(middles) else 0.0
    if not len(away) or not size > 0:
        return 0.0
    return float((np.percentile(away, MOST, axis=0) - np.percentile(away, LEAST, axis=0)).max()) / size
