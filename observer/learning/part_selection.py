"""Which body parts of a camera's own tracks a model learns from. Pure."""

import numpy as np

from observer.motion.archive import MotionArchive, movements_in
from observer.tracks import Floats

SEEN_SHARE = 0.5
"""A part is learned if it is seen in this share of the frames of each movement's takes."""


AUTO = "auto"
"""In place of names of parts: `parts_to_learn`."""


def parts_to_learn(archive: MotionArchive) -> tuple[str, ...]:
    """The parts that a model of these tracks reads, in their order; all parts if fewer than two remain.

    A part that the camera does not see in SEEN_SHARE of every movement, such as a foot behind a sofa, is no evidence,
    and a tracker's guesses of it mislead.
    """
    seen: dict[str, list[Floats]] = {}
    for take in movements_in(archive):
        if take.label:
            seen.setdefault(take.label, []).append(np.isfinite(take.positions).all(axis=2).mean(axis=0))
    shares = [np.mean(own, axis=0) for own in seen.values()]
    least = np.min(shares, axis=0) if shares else np.ones(len(archive.body_parts))
    parts = tuple(part for part, share in zip(archive.body_parts, least, strict=True) if share >= SEEN_SHARE)
    return parts if len(parts) > 1 else archive.body_parts
