"""The tracker of who brings tracks: it only sorts them into seen, unsure and missing."""

from collections.abc import Sequence

import numpy as np

from observer.tracks import Frame, Tracks

SURE = 0.5
"""Confidence from which on a part counts as seen, as most trackers mean theirs; below it is a guess."""


class ForeignTracker:
    """A `observer.tracks.Tracker` of frames whose content is (P, 3): u, v, confidence 0 to 1; NaN: not seen."""

    def __init__(self, body_parts: Sequence[str]) -> None:
        self.body_parts = tuple(body_parts)

    def update(self, frame: Frame) -> Tracks:
        """Centres where confidence ≥ 0.5, guesses below."""
        sure = frame.content[:, 2:] >= SURE
        places = frame.content[:, :2].astype(np.float64)
        return Tracks(np.where(sure, places, np.nan), np.where(sure, np.nan, places))
