"""The body in the image: how large it is, whether the person is still, and where it is. Pure; from past frames only.

A person walks about, comes nearer, leaves, and another one comes; a tracker makes mistakes and loses parts. Features
are therefore relative to a point and a length that are measured anew whenever the person is still, whatever the posture
(docs/design/model.md).
"""

import math
from collections.abc import Sequence

import numpy as np

from common.errors import BadInput
from observer.tracks import Floats, Tracks

TORSO_SHARE = 0.45
"""With a hanging arm, head and hand are about as far apart as head and hip plus a hand; 0.45 of it is about a torso."""
_SIDES = ("left", "right")
TORSO_LENGTHS = {
    **{("head", f"{side}_hand"): TORSO_SHARE for side in _SIDES},
    **{("head", f"{side}_foot"): 0.26 for side in _SIDES},
    **{("head", f"{side}_hip"): 0.61 for side in _SIDES},
    **{("neck", f"{side}_hip"): 0.82 for side in _SIDES},
    **{(f"{side}_shoulder", f"{other}_hip"): 0.92 for side, other in zip(_SIDES, _SIDES[::-1], strict=True)},
    **{(f"{side}_hip", f"{side}_knee"): 0.84 for side in _SIDES},
    **{(f"{side}_knee", f"{side}_foot"): 0.96 for side in _SIDES},
    ("head", "pelvis"): 0.67,
    ("neck", "pelvis"): 0.9,
}
"""Pairs of parts, and the torso's share of their distance, median over the people of karate and nw_ucla."""
FRAMES = 5
"""The size is a quantile over so many frames, so that one false frame does not decide."""


class BodyReach:
    """How large the body looks: distances of its parts, each as a multiple of what it is for a torso of length 1.

    Parts without a pair in TORSO_LENGTHS: the largest distance of any two, times TORSO_SHARE.
    """

    def __init__(self, body_parts: Sequence[str]) -> None:
        if len(body_parts) < 2:
            raise BadInput(f"body_parts = {list(body_parts)}: the body's size needs at least two parts; add head")
        row = {part: n for n, part in enumerate(body_parts)}
        pairs = [(row[a], row[b], share) for (a, b), share in TORSO_LENGTHS.items() if a in row and b in row]
        pairs = pairs or [(a, b, TORSO_SHARE) for b in range(len(row)) for a in range(b)]
        self._ends = np.array([[pair[0] for pair in pairs], [pair[1] for pair in pairs]])
        self._shares = np.array([pair[2] for pair in pairs])
        self._last: list[float] = []

    @property
    def steady(self) -> bool:
        """Whether one false frame can no longer decide."""
        return len(self._last) == FRAMES

    def update(self, centres: Floats) -> float:
        """(P, 2) -> the third largest of the last FRAMES frames' sizes; NaN until one is known.

        A frame's size is its largest length, or with many pairs one that a quarter of them reach, so that one false
        part does not decide.
        """
        ones, others = centres[self._ends]
        across = ones - others
        lengths = np.hypot(across[:, 0], across[:, 1]) * self._shares
        lengths = np.sort(lengths[lengths > 0])
        if len(lengths):
            self._last = [*self._last[1 - FRAMES :], float(lengths[-1 - len(lengths) // 4])]
        return sorted(self._last)[(len(self._last) - 1) // 2] if self._last else math.nan


HALF_S = 0.2
"""Stillness compares the mean places in two windows of this length."""
SLOW_PER_S = 0.35
"""Body sizes a second: half still. Movements are faster."""
CARRIED_PARTS = 3
"""Fewest parts whose median motion sideways is that of the whole body."""
TREMBLES = 2.5
"""Standard deviations of the tracker's noise that are half still."""
STEEPNESS = 4
TREMBLING_S, EVERY_S = 5.0, 0.3
"""How far back a tracker's trembling is measured, and how often."""
QUIET_SHARE = 0.2
"""The noise is that of the quietest fifth of these frames: in the others the person moves."""
OF_JERKS = math.sqrt(6) * math.sqrt(-2 * math.log(1 - QUIET_SHARE))
"""The QUIET_SHARE quantile of the length of the second difference of 2-D white noise with standard deviation 1: that
has sqrt(1 + 4 + 1) times the deviation, and a length is Rayleigh distributed."""
JERK = np.array([1.0, -2.0, 1.0])
USUAL_NOISE, MOST_NOISE, USUAL_FRAMES = 0.03, 0.08, 10.0
"""Body sizes: noise before any frame, its weight in frames, and the most noise. Kinect's hands tremble 1 to 3 cm."""


class Stillness:
    """P(the person is still) in each frame: no part moves faster than its tracker trembles, whatever the posture.

    body_parts: names of the P parts, at least two. Each part's trembling is estimated from the stream itself.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        self._parts, self._half = len(body_parts), max(round(HALF_S * rate_hz), 2)
        self._half_s, self._memory = self._half / rate_hz, round(TREMBLING_S * rate_hz)
        self._every = max(round(EVERY_S * rate_hz), 1)
        self._reach = BodyReach(body_parts)
        self._window: Floats = np.full((2 * self._half, self._parts, 2), np.nan)
        self._jerks: Floats = np.full((self._parts, self._memory), np.nan)
        self._measured, self._usual = np.zeros(self._parts), np.full(self._parts, USUAL_NOISE)
        self._frames, self._size = 0, math.nan
        self.probability = 0.5
        """In the newest frame; 0.5 while nothing is known."""

    def update(self, tracks: Tracks, size: float | None = None) -> float:
        """P(still) after one more frame. size: the body's in the image, NaN while unknown; None: found here."""
        self._window[:-1] = self._window[1:]
        self._window[-1] = tracks.centres
        jerk = JERK @ self._window[-3:].reshape(3, -1)
        self._jerks[:, self._frames % self._memory] = np.hypot(jerk[::2], jerk[1::2])
        if size is None:
            reach = self._reach.update(tracks.centres)
            self._size = self._size if reach <= self._size else reach
            size = self._size
        if self._frames % self._every == 0:
            self._measure_trembling()
        self._frames += 1
        speeds = self._speeds()
        limits = np.hypot(SLOW_PER_S * size, TREMBLES * self._noise_of(size) * math.sqrt(2 / self._half) / self._half_s)
        ratio = float(np.fmax.reduce(speeds / limits))
        self.probability = 0.5 if math.isnan(ratio) else 1 / (1 + ratio**STEEPNESS)
        return self.probability

    def _speeds(self) -> Floats:
        """(P,) image units a second, between the mean places in both halves; NaN where one does not show the part."""
        halves = self._window.reshape(2, self._half, -1, 2)
        sums = halves.sum(axis=1)
        if math.isfinite(sums.sum()):
            way = (sums[1] - sums[0]) / self._half
            sideways = np.sort(way[:, 0])
        else:
            known = halves == halves
            with np.errstate(invalid="ignore"):
                places = np.where(known, halves, 0.0).sum(axis=1) / known.sum(axis=1)
            way = places[1] - places[0]
            sideways = np.sort(way[np.isfinite(way[:, 0]), 0])
        if len(sideways) >= CARRIED_PARTS:
            # The median; NumPy's takes longer than all the rest.
            way[:, 0] -= (sideways[(len(sideways) - 1) // 2] + sideways[len(sideways) // 2]) / 2
        speeds: Floats = np.hypot(way[:, 0], way[:, 1]) / self._half_s
        return speeds

    def _measure_trembling(self) -> None:
        """By the jerks of each part (P,): the standard deviation of its coordinates, as far as it is known."""
        jerks = np.sort(self._jerks, axis=1)
        counts = np.isfinite(jerks).sum(axis=1)
        quiet = jerks[np.arange(self._parts), (QUIET_SHARE * counts).astype(int)] / OF_JERKS
        weights = counts / (counts + USUAL_FRAMES)
        self._measured, self._usual = np.where(counts > 0, weights * quiet, 0.0), (1 - weights) * USUAL_NOISE

    def _noise_of(self, size: float) -> Floats:
        """(P,) standard deviation of each part's coordinates in the image, of what is measured and what is usual."""
        mixed: Floats = self._measured + self._usual * size
        return np.minimum(mixed, MOST_NOISE * size)


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
            self._offsets += np.nan_to_num(0.2 * (offsets - self._offsets))
            return best
        for point, offset in zip(points[1:], self._offsets[1:], strict=True):
            if math.isfinite(point[0]):
                stand_in: Floats = point + np.nan_to_num(offset)
                return stand_in
        return best


FORGET_PERSON_S = 1.0
"""After nobody was seen for this long, the next person may be another one."""
FOLLOW_S, FOLLOW_STILL_S = 10.0, 0.15
"""Time constants of the origin: in movement, so that it does not follow a person who bends, and while still."""
SHRINK_S, SHRINK_STILL_S = 30.0, 0.4
"""Time constants with which the size approaches a smaller reach."""


class BodyFrame:
    """The origin of positions and the body's size in each frame of a stream of tracks.

    body_parts: names of the P parts, at least two, in any order. A part with a name that is neither in TRUNK_POINTS nor
    in TORSO_LENGTHS tells place and size only where no known one does. Raises BadInput for fewer than two.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        self._body_parts, self._rate_hz, self._unseen = body_parts, rate_hz, 0
        self._begin()

    def _begin(self) -> None:
        """Start anew, with another person."""
        self._anchor, self._reach = BodyAnchor(self._body_parts, self._rate_hz), BodyReach(self._body_parts)
        self._stillness = Stillness(self._body_parts, self._rate_hz)
        self.origin: Floats = np.full(2, np.nan)
        """(2,) the origin of positions in the image; NaN until known."""
        self.size = math.nan
        """The body's size in the image; NaN until known."""

    @property
    def seen(self) -> bool:
        """Whether any part is seen in this frame."""
        return self._unseen == 0

    @property
    def anchor(self) -> Floats:
        """(2,) the body's place: the head, or what else there is; held while not seen, NaN before the first sight."""
        return self._anchor.place

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
            self._begin()
        anchor, reach = self._anchor.update(tracks.centres), self._reach.update(tracks.centres)
        still = self._stillness.update(tracks, self.size)
        if not (reach <= self.size and self._reach.steady):
            self.size = reach if math.isfinite(reach) else self.size
        else:
            self.size += (reach - self.size) * self._share(still, SHRINK_STILL_S, SHRINK_S)
        if math.isnan(self.origin[0]):
            self.origin = anchor
        else:
            self.origin = self.origin + (anchor - self.origin) * self._share(still, FOLLOW_STILL_S, FOLLOW_S)
        return self.origin, self.size

    def _share(self, still: float, still_s: float, moving_s: float) -> float:
        """The share of a difference that is made up in this frame, by the time constants at rest and in movement."""
        return 1 - math.exp(-(still / still_s + (1 - still) / moving_s) / self._rate_hz)
