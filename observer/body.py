"""The body in the image: where it is, and how large it is. Pure; from past frames only.

A person walks about, comes nearer, leaves, and another one comes; a tracker makes mistakes and loses parts. Features
are therefore relative to a point and a length that are measured anew whenever the person is still
(docs/design/model.md).
"""

import math
from collections.abc import Sequence

import numpy as np

from observer.stillness import BodyReach, Stillness
from observer.tracks import Floats, Tracks

FORGET_PERSON_S = 1.0
"""After nobody was seen for this long, the next person may be another one."""
FOLLOW_S, FOLLOW_STILL_S = 10.0, 0.15
"""Time constants of the origin: in movement, so that it does not follow a person who bends, and while still."""
SHRINK_S, SHRINK_STILL_S = 30.0, 0.4
"""Time constants with which the size approaches a smaller reach."""


class BodyFrame:
    """The origin of positions and the body's size in each frame of a stream of tracks.

    body_parts: names of the P parts, at least two, in any order. A part with a name that is neither in TRUNK_POINTS nor
    in `stillness.TORSO_LENGTHS` tells place and size only where no known one does. Raises BadInput for fewer than two.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        self._anchor, self._reach = BodyAnchor(body_parts, rate_hz), BodyReach(body_parts)
        self._stillness = Stillness(body_parts, rate_hz)
        self._rate_hz, self._unseen = rate_hz, 0
        self._origin: Floats = np.full(2, np.nan)
        self._size = math.nan

    @property
    def seen(self) -> bool:
        """Whether any part is seen in this frame."""
        return self._unseen == 0

    @property
    def anchor(self) -> Floats:
        """(2,) the body's place in this frame: the head, or what else there is; held while it is not seen.

        NaN before the first sight of a person.
        """
        return self._anchor.place.copy()

    @property
    def origin(self) -> Floats:
        """(2,) the origin of positions in the image; NaN until known."""
        return self._origin.copy()

    @property
    def size(self) -> float:
        """The body's size in the image; NaN until known."""
        return self._size

    @property
    def still(self) -> float:
        """P(the person is still) in this frame."""
        return self._stillness.probability

    def update(self, tracks: Tracks) -> tuple[Floats, float]:
        """(P, 2) tracks -> (2,) the origin of positions in the image, and the body's size in the same unit.

        The origin is the anchor where the person was last still; in movement it follows slowly. The size is about the
        torso's length; it grows at once, and shrinks while the person is still. Both are NaN until known.
        """
        self._unseen = 0 if tracks.visible.any() else self._unseen + 1
        if self._unseen > FORGET_PERSON_S * self._rate_hz:
            self._forget()
        anchor, reach = self._anchor.update(tracks.centres), self._reach.update(tracks.centres)
        still = self._stillness.update(tracks, self._size)
        if not (reach <= self._size and self._reach.steady):
            self._size = reach if math.isfinite(reach) else self._size
        else:
            self._size += (reach - self._size) * self._share(still, SHRINK_STILL_S, SHRINK_S)
        if math.isnan(self._origin[0]):
            self._origin = anchor.copy()
        else:
            self._origin += (anchor - self._origin) * self._share(still, FOLLOW_STILL_S, FOLLOW_S)
        return self._origin.copy(), self._size

    def _share(self, still: float, still_s: float, moving_s: float) -> float:
        """The share of a difference that is made up in this frame, by the time constants at rest and in movement."""
        return 1 - math.exp(-(still / still_s + (1 - still) / moving_s) / self._rate_hz)

    def _forget(self) -> None:
        self._origin, self._size = np.full(2, np.nan), math.nan
        self._anchor.forget()
        self._reach.forget()
        self._stillness.forget()


TRUNK_POINTS = (("head",), ("neck",), ("left_shoulder", "right_shoulder"), ("pelvis",), ("left_hip", "right_hip"))
"""Points that stand for the body's place, best first: a part, or the middle of two."""
STEADY_S = 0.3
"""Up to this time the place is the median since the first frame, because one error would misplace all later frames."""


class BodyAnchor:
    """The body's place in the image: the first point of TRUNK_POINTS that its parts have, else the mean of all parts.

    While it is not seen, the next point stands in for it, at the distance at which both were last seen together.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        points = [[list(body_parts).index(p) for p in point] for point in TRUNK_POINTS if set(point) <= set(body_parts)]
        self._ends = np.array([[p[0] for p in points], [p[-1] for p in points]], np.int64)
        self._parts = len(body_parts)
        self._recent = max(round(STEADY_S * rate_hz), 1)
        self.forget()

    def forget(self) -> None:
        """Forget the place and what is known of the parts: another person may be seen now."""
        self.place: Floats = np.full(2, np.nan)
        self._offsets: Floats = np.full((max(self._ends.shape[1], 1), 2), np.nan)
        self._first: list[Floats] = []
        self._held: Floats = np.full((self._parts, 2), np.nan)

    def update(self, centres: Floats) -> Floats:
        """(P, 2) -> (2,) the place in this frame, held while no part tells it."""
        place = self._of_trunk(centres) if self._ends.size else self._of_all(centres)
        if math.isfinite(place[0]):
            if len(self._first) < self._recent:
                self._first.append(place)
                place = np.sort(self._first, axis=0)[(len(self._first) - 1) // 2]
            self.place = place
        return self.place

    def _of_all(self, centres: Floats) -> Floats:
        """The mean of the parts' last positions."""
        np.copyto(self._held, centres, where=np.isfinite(centres))
        known = self._held[np.isfinite(self._held[:, 0])]
        return known.mean(axis=0) if len(known) else self.place

    def _of_trunk(self, centres: Floats) -> Floats:
        ones, others = centres[self._ends]
        points: Floats = (ones + others) / 2
        best: Floats = points[0]
        if len(points) == 1:
            return best
        if math.isfinite(best[0]):
            offsets = best - points
            np.copyto(self._offsets, offsets, where=np.isnan(self._offsets))
            change = 0.2 * (offsets - self._offsets)
            change[np.isnan(change)] = 0.0
            self._offsets += change
            return best
        for point, offset in zip(points[1:], self._offsets[1:], strict=True):
            if math.isfinite(point[0]):
                stand_in: Floats = point + np.nan_to_num(offset)
                return stand_in
        return best
