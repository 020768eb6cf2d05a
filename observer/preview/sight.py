"""What an observer sees and computes at one frame, collected for display; pure."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.probability import entropy_bits
from observer.features import SpaceReader, Symbols
from observer.tracks import Floats, Tracks

Picture = NDArray[np.uint8]
"""(H, W, 3) in the order blue, green, red, 0 to 255, or (H, W) grey."""

SYMBOL_FRAMES = 40
"""Number of frames whose Vector Symbols are shown."""
TRAIL = 12
"""Number of frames in the trail of each part."""
PERSON_MARGIN = 0.5
"""Margin about recorded motion, as a share of the person's extent."""
OVER_S, STILL = 0.2, 0.12
"""Arrows show the motion over this time; less than this share of the person's size counts as still: about 0.3 m/s."""


@dataclass(frozen=True, slots=True, eq=False)
class ShownPosterior:
    """labels: names of the M movements. p: (M,) posterior over them. rest: probability that the person is at rest."""

    labels: tuple[str, ...]
    p: Floats
    rest: float

    @property
    def entropy_bits(self) -> float:
        """Entropy of p, 0 to log2 M bits."""
        return float(entropy_bits(self.p))

    @property
    def winner(self) -> int | None:
        """Index of the most probable movement; None for a tie."""
        best = int(np.argmax(self.p))
        return best if int((self.p == self.p[best]).sum()) == 1 else None

    def most_probable(self, count: int) -> list[int]:
        """Indices of the `count` most probable movements, in the order of the vocabulary."""
        best = np.argsort(-self.p, kind="stable")[:count]
        return sorted(int(i) for i in best)


@dataclass(frozen=True, slots=True, eq=False)
class PreviewFrame:
    """One frame to be painted; P body parts, T frames of history, newest last.

    tracks: in px of the picture, or in any unit without one. trail: (T, P, 2) centres, NaN where not seen. symbols:
    (T, P) of `observer.features.VectorSymbol`. extent: (2, 2) corners of all motion so far, None before any was
    seen; used only without a picture. back_projection: (H, W) uint8 of skin colour. frame: its number from 0. age_s:
    seconds since capture. complaint: what is wrong, in words; "" when nothing is.
    """

    tracks: Tracks
    body_parts: tuple[str, ...]
    trail: Floats
    symbols: Symbols
    extent: Floats | None = None
    back_projection: Picture | None = None
    posterior: ShownPosterior | None = None
    title: str = ""
    frame: int = 0
    age_s: float | None = None
    complaint: str = ""


class MotionExtent:
    """The extent of all motion so far; it never shrinks, so that the scale of the picture stays steady.

    margin: about the motion, as a share of the person's extent. corners: (2, 2); None before any motion was seen.
    """

    def __init__(self, margin: float) -> None:
        self._margin, self._person_size = margin, 0.0
        self.corners: Floats | None = None

    def widen(self, centres: Floats) -> None:
        """Take in (P, 2) centres, NaN where not seen."""
        seen = centres[np.isfinite(centres).all(axis=1)]
        if not len(seen):
            return
        self._person_size = max(self._person_size, float(np.linalg.norm(seen[:, None] - seen[None], axis=-1).max()))
        margin = self._margin * self._person_size
        corners = np.array([seen.min(axis=0) - margin, seen.max(axis=0) + margin])
        if self.corners is not None:
            corners = np.array([np.minimum(corners[0], self.corners[0]), np.maximum(corners[1], self.corners[1])])
        self.corners = corners


class PreviewHistory:
    """Remembers the last frames, and makes a PreviewFrame of each new one.

    rate_hz: of the frames. `add` raises BadInput, as `SpaceReader` does, for body parts without a head or a hand.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float, title: str = "") -> None:
        self._body_parts, self._title = tuple(body_parts), title
        self._reader = SpaceReader(self._body_parts, STILL, max(1, round(OVER_S * rate_hz)))
        self._symbols: deque[Symbols] = deque(maxlen=SYMBOL_FRAMES)
        self._trail: deque[Floats] = deque(maxlen=TRAIL)
        self._extent = MotionExtent(PERSON_MARGIN)
        self._frames = 0

    def add(
        self,
        tracks: Tracks,
        *,
        posterior: ShownPosterior | None = None,
        back_projection: Picture | None = None,
        age_s: float | None = None,
        complaint: str = "",
    ) -> PreviewFrame:
        """Add the next frame; arguments as in `PreviewFrame`."""
        self._symbols.append(self._reader.update(tracks))
        self._trail.append(tracks.centres)
        self._extent.widen(tracks.centres)
        self._frames += 1
        return PreviewFrame(
            tracks,
            self._body_parts,
            np.array(self._trail),
            np.array(self._symbols),
            self._extent.corners,
            back_projection,
            posterior,
            self._title,
            self._frames - 1,
            age_s,
            complaint,
        )
