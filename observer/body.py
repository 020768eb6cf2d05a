"""The body in the image: where it is, how large it is, and whether it is still. Pure; from past frames only.

A person walks about, comes nearer, leaves, and another one comes; a tracker makes mistakes and loses parts. Features
are therefore relative to a point and a length that are measured anew whenever the person is still
(docs/design/model.md).
"""

import math
from collections.abc import Sequence

import numpy as np

from common.errors import BadInput
from observer.tracks import Floats, Tracks

TORSO_SHARE = 0.45
"""With a hanging arm, head and hand are about as far apart as head and hip plus a hand; 0.45 of it is about a torso."""
FORGET_S = 1.0
"""After nobody was seen for this long, the next person may be another one."""


class BodyFrame:
    """A point of reference and the body's size in each frame of a stream of tracks.

    body_parts: names of the P parts, in any order; at least two. Known names are those of the trunk, head, hands,
    elbows, knees and feet; the others count for the size only. Raises BadInput for fewer than two parts.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        self._anchor, self._reach = _Anchor(body_parts, rate_hz), _Reach(body_parts, rate_hz)
        self._stillness = Stillness(body_parts, rate_hz)
        self._rate_hz, self._unseen = rate_hz, 0
        self._forget()

    def _forget(self) -> None:
        self._origin: Floats = np.full(2, np.nan)
        self._size = math.nan
        self._anchor.forget()
        self._reach.forget()
        self._stillness.forget()

    @property
    def anchor(self) -> Floats:
        """(2,) the body's place in this frame: head, neck, or what else there is; held while it is not seen.

        NaN before the first sight of a person.
        """
        return self._anchor.place.copy()

    @property
    def still(self) -> float:
        """P(still) in this frame."""
        return self._stillness.probability

    def update(self, tracks: Tracks) -> tuple[Floats, float]:
        """(P, 2) tracks -> (2,) the origin of positions, in the image, and the body's size in the same unit.

        The origin is the anchor where the person last was still, following it slowly in between. The size is about the
        torso's length: it grows at once, and shrinks while the person is still. NaN until known.
        """
        if not tracks.visible.any():
            self._unseen += 1
            if self._unseen > FORGET_S * self._rate_hz:
                self._forget()
        else:
            self._unseen = 0
        reach = self._reach.update(tracks.centres)
        anchor = self._anchor.update(tracks.centres)
        still = self._stillness.update(tracks, self._size)
        self._follow_size(reach, still)
        self._follow_anchor(anchor, still)
        return self._origin.copy(), self._size

    def _follow_size(self, reach: float, still: float) -> None:
        if not reach <= self._size or not self._reach.steady:
            self._size = reach if math.isfinite(reach) else self._size
        else:
            share = still / SHRINK_STILL_S + (1 - still) / SHRINK_S
            self._size += (reach - self._size) * (1 - math.exp(-share / self._rate_hz))

    def _follow_anchor(self, anchor: Floats, still: float) -> None:
        if math.isnan(self._origin[0]):
            self._origin = anchor.copy()
        else:
            share = still / FOLLOW_STILL_S + (1 - still) / FOLLOW_S
            self._origin += (anchor - self._origin) * (1 - math.exp(-share / self._rate_hz))


FOLLOW_S, FOLLOW_STILL_S = 10.0, 0.15
"""Time constants of the origin: in movement, so that it does not follow a person who bends, and while still."""
SHRINK_S, SHRINK_STILL_S = 30.0, 0.4
"""Time constants with which the size approaches a smaller reach."""


class _Anchor:
    """The body's place in the image: the first of TRUNK that the parts have, else the mean of all parts.

    While that is not seen, others of the trunk stand in for it, at the distance at which they were last seen together.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        rows = [[list(body_parts).index(part) for part in point if part in body_parts] for point in TRUNK]
        self._points = [r for r, point in zip(rows, TRUNK, strict=True) if len(r) == len(point)]
        self._points = self._points or [list(range(len(body_parts)))]
        self._parts = len(body_parts)
        self._recent = max(round(STEADY_S * rate_hz), 1)
        self.forget()

    def forget(self) -> None:
        """Start anew, with another person."""
        self.place: Floats = np.full(2, np.nan)
        self._offsets: Floats = np.full((len(self._points), 2), np.nan)
        self._first: list[Floats] = []
        self._held: Floats = np.full((self._parts, 2), np.nan)

    def update(self, centres: Floats) -> Floats:
        """(P, 2) -> (2,) the place in this frame, held while nothing tells it; the median of the first frames."""
        if len(self._points) > 1 or len(self._points[0]) < self._parts:
            points: Floats = np.array([centres[rows].mean(axis=0) for rows in self._points])
        else:
            self._held = np.where(np.isfinite(centres), centres, self._held)
            seen = np.isfinite(self._held[:, 0])
            points = self._held[seen].mean(axis=0, keepdims=True) if seen.any() else np.full((1, 2), np.nan)
        place = self._best(points)
        if not math.isnan(place[0]):
            # One false frame, the first of all, would misplace everything after it.
            if len(self._first) < self._recent:
                self._first.append(place)
                place = np.sort(self._first, axis=0)[(len(self._first) - 1) // 2]
            self.place = place
        return self.place

    def _best(self, points: Floats) -> Floats:
        seen = np.isfinite(points[:, 0])
        if seen[0]:
            offsets = points[0] - points
            known = np.isfinite(self._offsets)
            smooth = np.where(known, 0.8 * self._offsets + 0.2 * offsets, offsets)
            self._offsets = np.where(seen[:, None], smooth, self._offsets)
            first: Floats = points[0]
            return first
        for point, offset in zip(points[1:], self._offsets[1:], strict=True):
            if math.isfinite(point[0]):
                stand_in: Floats = point + np.nan_to_num(offset)
                return stand_in
        return np.full(2, np.nan)


STEADY_S = 0.3
TRUNK = (("head",), ("neck",), ("left_shoulder", "right_shoulder"), ("pelvis",), ("left_hip", "right_hip"))
"""Points that stand for the body's place, best first."""


class _Reach:
    """How large the body looks: distances of its parts as shares of what they are on a person, robust to mistakes."""

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        index = {part: row for row, part in enumerate(body_parts)}
        pairs = [(index[a], index[b], share) for (a, b), share in LENGTHS.items() if a in index and b in index]
        if len(body_parts) < 2:
            raise BadInput(f"body_parts = {list(body_parts)}: the body's size needs at least two parts; add head")
        if not pairs:
            pairs = [(a, b, TORSO_SHARE) for b in range(len(body_parts)) for a in range(b)]
        self._one, self._other = (np.array([pair[k] for pair in pairs]) for k in (0, 1))
        self._shares = np.array([pair[2] for pair in pairs])
        self.forget()

    def forget(self) -> None:
        """Start anew, with another person."""
        self._last: list[float] = []

    @property
    def steady(self) -> bool:
        """Whether one false frame can no longer decide."""
        return len(self._last) == 5

    def update(self, centres: Floats) -> float:
        """(P, 2) -> the third largest of the last five frames' sizes; NaN until one is known."""
        lengths = np.linalg.norm(centres[self._one] - centres[self._other], axis=1) * self._shares
        lengths = lengths[lengths > 0]
        if len(lengths):
            self._last = [*self._last[-4:], float(lengths.max())]
        return sorted(self._last)[(len(self._last) - 1) // 2] if self._last else math.nan


LENGTHS = {("head", "left_hand"): TORSO_SHARE, ("head", "right_hand"): TORSO_SHARE}
"""Pairs of parts, and the torso's share of their largest distance."""


class Stillness:
    """P(the person is still) in each frame: no part moves faster than its tracker trembles.

    body_parts: names of the P parts. The trembling is estimated from the stream itself, part by part.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        self._parts, self._rate_hz = len(body_parts), rate_hz
        self._half = max(round(HALF_S * rate_hz), 2)
        self._reach = _Reach(body_parts, rate_hz)
        self._memory = round(TREMBLING_S * rate_hz)
        self.forget()

    def forget(self) -> None:
        """Start anew, with another person."""
        self._last: Floats = np.full((2 * self._half, self._parts, 2), np.nan)
        self._jerks: Floats = np.full((self._memory, self._parts), np.nan)
        self._frames = 0
        self._size = math.nan
        self.probability = 0.5
        self._reach.forget()

    def update(self, tracks: Tracks, size: float | None = None) -> float:
        """P(still) after one more frame; 0.5 as long as nothing is known. size: the body's, if it is known."""
        self._last = np.concatenate([self._last[1:], tracks.centres[None]])
        self._note_trembling()
        self._frames += 1
        if size is None:
            reach = self._reach.update(tracks.centres)
            self._size = reach if not reach <= self._size else self._size
            size = self._size
        speeds = self._speeds()
        known = np.isfinite(speeds)
        if not known.any() or math.isnan(size):
            self.probability = 0.5
            return self.probability
        noise = self._trembling(size) * math.sqrt(2 / self._half) / (self._half / self._rate_hz)
        limits = np.hypot(SLOW_PER_S, TREMBLES * noise)
        ratio = float((speeds / size / limits)[known].max())
        self.probability = 1 / (1 + ratio**STEEP)
        return self.probability

    def _speeds(self) -> Floats:
        """(P,) image units a second, between the means of the window's halves; NaN where a half does not show it."""
        seen = np.isfinite(self._last[..., 0]).reshape(2, self._half, -1)
        places = np.where(seen[..., None], self._last.reshape(2, self._half, -1, 2), 0.0)
        counts = seen.sum(axis=1)
        with np.errstate(invalid="ignore"):
            means = places.sum(axis=1) / counts[..., None]
        speeds: Floats = np.linalg.norm(means[1] - means[0], axis=-1) / (self._half / self._rate_hz)
        return speeds

    def _note_trembling(self) -> None:
        before, middle, now = self._last[-3:]
        self._jerks[self._frames % self._memory] = np.linalg.norm(now - 2 * middle + before, axis=1)

    def _trembling(self, size: float) -> Floats:
        """(P,) standard deviation of the noise of each part's coordinates, in body sizes."""
        jerks = np.sort(self._jerks[: max(self._frames, 1)] / size, axis=0)
        count = np.isfinite(jerks).sum(axis=0)
        low = jerks[(QUIET * count).astype(int).clip(0, len(jerks) - 1), np.arange(self._parts)]
        sigma = np.nan_to_num(low) / OF_JERKS
        share = count / (count + PRIOR_FRAMES)
        result: Floats = np.minimum(share * sigma + (1 - share) * PRIOR_NOISE, MOST_NOISE)
        return result


HALF_S = 0.2
"""Two windows of this length are compared."""
TREMBLING_S = 5.0
SLOW_PER_S = 0.35
"""Body sizes a second: as slow as this is still; a shift of weight is slower."""
TREMBLES = 2.5
STEEP = 4
QUIET = 0.2
"""The quietest fifth of the last frames shows a tracker's trembling."""
OF_JERKS = math.sqrt(6) * math.sqrt(-2 * math.log(1 - QUIET))
"""The second difference of white noise with standard deviation 1 in two coordinates: its QUIET quantile."""
PRIOR_NOISE, MOST_NOISE, PRIOR_FRAMES = 0.03, 0.08, 10.0
"""Body sizes; Kinect's wrists tremble 1 to 3 cm."""
