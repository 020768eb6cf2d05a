"""What an observer sees and believes at one frame, gathered for people to look at. Pure."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.probability import entropy_bits
from observer.features.space import SpaceReader, Symbols
from observer.tracks import Floats, Tracks

Picture = NDArray[np.uint8]
"""(H, W, 3) blue, green, red, 0 to 255, or (H, W) grey."""

SYMBOLS = 40
"""So many frames of Vector Symbols are shown."""
TRAIL = 12
"""So many frames of each part's way are shown."""
ROOM = 0.5
"""Room left about what was seen of recorded motion, as a share of the person's reach."""
OVER_S, STILL = 0.2, 0.12
"""Arrows show the motion of so many seconds; less than this share of the person's size is still: about 0.3 m/s."""


@dataclass(frozen=True, slots=True, eq=False)
class ShownPosterior:
    """labels: names of the M movements. p: (M,) posterior over them. rest: probability that the person is at rest."""

    labels: tuple[str, ...]
    p: Floats
    rest: float

    @property
    def entropy_bits(self) -> float:
        """0 (certain) to log2 M (knows nothing)."""
        return float(entropy_bits(self.p))

    @property
    def winner(self) -> int | None:
        """Index of the most probable movement; None while none is more probable than all others."""
        best = int(np.argmax(self.p))
        return best if int((self.p == self.p[best]).sum()) == 1 else None

    def shown(self, most: int) -> list[int]:
        """Indexes of the `most` most probable movements, in the order of the vocabulary so that bars stay in place."""
        best = np.argsort(-self.p, kind="stable")[:most]
        return sorted(int(i) for i in best)


@dataclass(frozen=True, slots=True, eq=False)
class PreviewFrame:
    """One frame as a person should see it; P body parts, T frames back, newest last.

    tracks: in px of the picture, or in any unit where there is none. trail: (T, P, 2) centres, NaN where not seen.
    symbols: (T, P) of `VectorSymbol`. extent: (2, 2) corners that hold all motion so far, None before
    any was seen; only used without a picture. back_projection: (H, W) uint8, where skin colour is. frame: its number
    from 0. age_s: seconds since capture. complaint: what is wrong, in words; "" when nothing is.
    """

    tracks: Tracks
    body_parts: tuple[str, ...]
    trail: Floats
    symbols: Symbols
    extent: Floats | None = None
    back_projection: Picture | None = None
    belief: ShownPosterior | None = None
    title: str = ""
    frame: int = 0
    age_s: float | None = None
    complaint: str = ""


class PreviewHistory:
    """Remembers the last frames, and makes of each new one a Sight.

    rate_hz: of the frames. `see` raises BadInput, as `SpaceReader` does, for parts without a head or a
    hand.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float, title: str = "") -> None:
        self._body_parts, self._title = tuple(body_parts), title
        self._reader = SpaceReader(self._body_parts, STILL, max(1, round(OVER_S * rate_hz)))
        self._symbols: deque[Symbols] = deque(maxlen=SYMBOLS)
        self._trail: deque[Floats] = deque(maxlen=TRAIL)
        self._extent: Floats | None = None
        self._reach = 0.0
        self._frames = 0

    def see(
        self,
        tracks: Tracks,
        *,
        belief: ShownPosterior | None = None,
        back_projection: Picture | None = None,
        age_s: float | None = None,
        complaint: str = "",
    ) -> PreviewFrame:
        """The next frame; other arguments as in `PreviewFrame`."""
        self._symbols.append(self._reader.update(tracks))
        self._trail.append(tracks.centres)
        self._widen(tracks.centres)
        self._frames += 1
        return PreviewFrame(
            tracks,
            self._body_parts,
            np.array(self._trail),
            np.array(self._symbols),
            self._extent,
            back_projection,
            belief,
            self._title,
            self._frames - 1,
            age_s,
            complaint,
        )

    def _widen(self, centres: Floats) -> None:
        """The extent only grows, or the canvas would breathe with the motion."""
        seen = centres[np.isfinite(centres).all(axis=1)]
        if not len(seen):
            return
        apart = float(np.linalg.norm(seen[:, None] - seen[None], axis=-1).max())
        self._reach = max(self._reach, apart)
        corners = np.array([seen.min(axis=0) - ROOM * self._reach, seen.max(axis=0) + ROOM * self._reach])
        if self._extent is not None:
            corners = np.array([np.minimum(corners[0], self._extent[0]), np.maximum(corners[1], self._extent[1])])
        self._extent = corners
