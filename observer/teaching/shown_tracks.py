"""A few frames of tracks for a teacher's eyes: the thumbnail of a take, or the body that is seen now. Pure."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.teaching_messages import SHOWN_UNITS, UNSEEN, ShownTracks

SHOWN_FRAMES = 24
"""With the 17 parts of a whole body that is 2.5 kB."""


def shown_tracks(centres: NDArray[np.floating[Any]], body_parts: Sequence[str], rate_hz: float) -> ShownTracks | None:
    """Frames of `centres` (F, P, 2), in any unit, thinned to at most SHOWN_FRAMES; None if nothing is seen in them.

    rate_hz: frames per second before they are thinned.
    """
    visible: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(centres), axis=2)
    if not visible.any():
        return None
    chosen = np.unique(np.linspace(0, len(centres) - 1, min(len(centres), SHOWN_FRAMES)).round().astype(int))
    left, top = np.nanmin(np.where(visible[..., None], centres, np.nan), axis=(0, 1))
    right, bottom = np.nanmax(np.where(visible[..., None], centres, np.nan), axis=(0, 1))
    size = max(float(right - left), float(bottom - top)) or 1.0
    scaled = (centres[chosen] - (left, top)) / size * SHOWN_UNITS
    points = np.where(visible[chosen][..., None], scaled, UNSEEN).round().astype(int)
    return ShownTracks(
        body_parts=list(body_parts),
        points=points.ravel().tolist(),
        seconds=len(centres) / rate_hz,
        left=float(left),
        top=float(top),
        size=size,
    )
