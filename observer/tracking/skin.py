"""The person's skin: a histogram of hue and saturation, its back-projection, and pieces of skin that are new hands."""

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.files import read_arrays, write_file
from observer.tracks import Floats

Picture = NDArray[Any]
HUES, SATURATIONS = 45, 32
HUE_SHIFT = 90
"""Skin lies near hue 0, where OpenCV's hue (0 to 179) wraps around; rotated by 90 it lies in the middle."""
DARK, BURNT, PALE = 40, 252, 12
"""Hue is noise at values (0 to 255) below DARK or above BURNT, and at saturations below PALE."""
MIN_PIXELS = 60
"""Fewest usable pixels from which a histogram is learned."""
SHADE = 20.0
"""Least standard deviation of the value of skin: hands are lit differently from the face."""
RARER, COMMON = 3.0, 0.05
"""If more than the share COMMON of the rest has the colour of skin, the prior of skin is lowered RARER times, provided
that this halves the share and keeps most of the skin. This separates skin from wood of a similar hue. It is not done
elsewhere because it loses hands that are lit differently from the face."""
LIKELY = 0.43
"""Probability from which a colour counts as skin."""
SEEN_ONCE = 2e-4
"""Frequency added to every colour of the rest of the picture: a colour that is absent proves little."""


def hue_saturation(picture: Picture) -> tuple[Picture, Picture]:
    """(H, W, 3) BGR uint8 -> hue, saturation and value (H, W, 3), and the mask (H, W) uint8 of usable pixels."""
    hsv = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)
    return hsv, cv2.inRange(hsv, (0, PALE, DARK), (180, 255, BURNT))


def counts(hsv: Picture, mask: Picture) -> Picture:
    """(45, 32) float32: number of pixels in the mask per rotated hue and saturation."""
    fine = cv2.calcHist([hsv], [0, 1], mask, [180, SATURATIONS], [0, 180, 0, 256])
    rotated = np.roll(fine, HUE_SHIFT, axis=0)
    summed: Picture = rotated.reshape(HUES, -1, SATURATIONS).sum(axis=1)
    return summed


def _frequencies(hsv: Picture, mask: Picture) -> Floats:
    smooth = cv2.GaussianBlur(counts(hsv, mask), (5, 5), 1.0, borderType=cv2.BORDER_REPLICATE)
    return smooth.astype(np.float64) / max(float(smooth.sum(dtype=np.float64)), 1e-9)


def _likely(skin: Floats, rest: Floats) -> Floats:
    """(45, 32) p(skin | colour), 0 to 1, with equal priors of skin and rest, or a lower prior of skin (see RARER)."""
    even, rare = (skin / (skin + times * rest + SEEN_ONCE) for times in (1.0, RARER))
    before, after = (float(rest[likely >= LIKELY].sum()) for likely in (even, rare))
    separates = after < before / 2 and float(skin[rare >= LIKELY].sum()) > 0.5
    return rare if before > COMMON and separates else even


def _table(skin: Floats, rest: Floats) -> Picture:
    """(90, 64) float32, 0 to 255: the table for `cv2.calcBackProject`, with hues not rotated.

    It is twice as fine as the histograms, so that the rotation and PALE coincide with bin edges.
    """
    ratio = 255 * _likely(skin, rest)
    hues = (np.arange(2 * HUES) * 2 + HUE_SHIFT) % 180 * HUES // 180
    table = np.repeat(ratio[hues], 2, axis=1).astype(np.float32)
    table[:, : PALE // 4] = 0
    return table


def _weights(mean: float, deviation: float) -> Picture:
    """(256,) uint8: 255 within two deviations of the mean value, Gaussian beyond; 0 where dark or burnt."""
    values = np.arange(256.0)
    excess = np.maximum(np.abs(values - mean) / max(deviation, SHADE) - 2, 0)
    usable = (values >= DARK) & (values <= BURNT)
    return np.where(usable, 255 * np.exp(-0.5 * excess**2), 0).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class SkinHistogram:
    """Relative frequencies of colours, each (45, 32) with sum 1, in the person's skin and in the rest of the picture.

    value: (2,) mean and standard deviation of the skin's value, 0 to 255: wood has the hue of skin, rarely its value.
    """

    skin: Floats
    rest: Floats
    value: Floats
    table: Picture = field(init=False, repr=False, compare=False)
    weights: Picture = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "table", _table(self.skin, self.rest))
        object.__setattr__(self, "weights", _weights(float(self.value[0]), float(self.value[1])))

    @classmethod
    def learn(
        cls, picture: Picture, box: tuple[int, int, int, int], rest: Picture | None = None
    ) -> "SkinHistogram | None":
        """Learn from the ellipse in `box` (x, y, width, height) of a face or marked region; None: too few pixels.

        rest: (H, W, 3) picture without skin, black pixels ignored; None takes the picture around the box.
        """
        hsv, usable = hue_saturation(picture)
        x, y, w, h = box
        ellipse = np.zeros_like(usable)
        cv2.ellipse(ellipse, (x + w // 2, y + h // 2), (max(w * 3 // 10, 1), max(h * 4 // 10, 1)), 0, 0, 360, 255, -1)
        inside = cv2.bitwise_and(usable, ellipse)
        if cv2.countNonZero(inside) < MIN_PIXELS:
            return None
        bright = hsv[..., 2][inside > 0]
        value = np.array([np.median(bright), bright.std()], dtype=np.float64)
        if rest is not None:
            return cls(_frequencies(hsv, inside), _frequencies(*hue_saturation(rest)), value)
        outside = usable.copy()
        outside[max(y - h // 4, 0) : y + h * 5 // 4, max(x - w // 4, 0) : x + w * 5 // 4] = 0
        return cls(_frequencies(hsv, inside), _frequencies(hsv, outside), value)

    def adapted(self, newer: "SkinHistogram", rate: float) -> "SkinHistogram":
        """The histogram moved by `rate` (0 to 1) towards a newer one: light changes slowly."""
        skin, rest = self.skin + rate * (newer.skin - self.skin), self.rest + rate * (newer.rest - self.rest)
        # The brightness of light changes faster than its colour.
        return SkinHistogram(skin, rest, self.value + min(3 * rate, 1.0) * (newer.value - self.value))

    def back_project(self, picture: Picture) -> Picture:
        """(H, W) uint8: 255 p(skin | colour); 0 where the colour is not usable."""
        hsv = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)
        back = cv2.calcBackProject([hsv], [0, 1], self.table, [0, 180, 0, 256], 1)
        return cv2.multiply(back, cv2.LUT(cv2.extractChannel(hsv, 2), self.weights), scale=1 / 255)

    def save(self, path: Path) -> None:
        """Write an .npz file; raises LabanmeshError when it cannot be written."""
        buffer = io.BytesIO()
        np.savez(buffer, skin=self.skin, rest=self.rest, value=self.value)
        write_file(path, buffer.getvalue(), "Choose another path with --save-skin")

    @classmethod
    def load(cls, path: Path) -> "SkinHistogram":
        """Read a file written by `save`; raises BadInput for anything else."""
        expected = (
            f"a skin histogram of two arrays ({HUES}, {SATURATIONS}) and a value (2,) is expected; learn it again with "
            "labanmesh camera look --save-skin"
        )
        try:
            arrays = read_arrays(path)
            skin, rest, value = (np.asarray(arrays[name], dtype=np.float64) for name in ("skin", "rest", "value"))
        except (OSError, ValueError, KeyError) as error:
            raise BadInput(f"{path}: {error}; {expected}") from None
        for numbers, shape in ((skin, (HUES, SATURATIONS)), (rest, (HUES, SATURATIONS)), (value, (2,))):
            if numbers.shape != shape or not (np.isfinite(numbers).all() and (numbers >= 0).all()):
                raise BadInput(f"{path}: shape {numbers.shape} or values below zero; {expected}")
        return cls(skin, rest, value)


@dataclass(frozen=True, slots=True)
class SkinPatch:
    """A connected piece of skin. centre: (2,) px. area: px² of skin colour. moved: share that moved, 0 to 1."""

    centre: Floats
    area: float
    moved: float = 0.0


CANDIDATE_FRAMES, PRESENT_S = 3, 0.13
"""A candidate is accepted after this many frames in a row, or after two that are as far apart as three of 15 Hz."""
LEAP, SPEED = 1.2, 18.0
"""Farthest that a candidate may move between two frames, face widths; in frames that are rare, face widths per s: as
far as that at 15 Hz, some 2.7 m/s."""
MOVED_SHARE = 0.3
"""Least share of a candidate's pixels that moved, in each of its frames: a lamp or a cupboard does not move."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A patch, and for how many frames in a row, and seconds, it was present."""

    patch: SkinPatch
    frames: int = 1
    seconds: float = 0.0

    @property
    def is_lasting(self) -> bool:
        """Whether it was present for long enough to be a hand."""
        return self.frames >= CANDIDATE_FRAMES or (self.frames > 1 and self.seconds >= PRESENT_S)


class HandAcquisition:
    """Accepts a moving patch of skin as a hand once it has been there for some frames, wherever it goes meanwhile."""

    def __init__(self) -> None:
        self._candidates: list[Candidate] = []

    def update(self, patches: Sequence[SkinPatch], face: float, seconds: float) -> list[SkinPatch]:
        """Patches that may be hands -> the accepted ones, best first.

        face: face width, px. seconds: since the frame before.
        """
        candidates, reach = [], max(LEAP, SPEED * seconds) * face
        previous = list(self._candidates)
        for patch in patches:
            if patch.moved < MOVED_SHARE:
                continue
            near = [c for c in previous if _distance(c.patch.centre, patch.centre) < reach]
            candidate = Candidate(patch)
            if near:
                nearest = min(near, key=lambda c: _distance(c.patch.centre, patch.centre))
                previous = [c for c in previous if c is not nearest]
                candidate = Candidate(patch, nearest.frames + 1, nearest.seconds + seconds)
            candidates.append(candidate)
        self._candidates = candidates
        best_first = sorted(candidates, key=lambda c: (-c.frames, -c.patch.area))
        return [c.patch for c in best_first if c.is_lasting]


HANGING = ((0.6, 2.6), (3.0, 6.5))
"""Where hands hang: distances beside and below the middle of the head, face widths."""
REST_S, TREMBLE = 0.6, 0.3
"""A hanging hand is accepted after this long, if it stays within this many face widths."""


class RestingHands:
    """Finds a hand that does not move: the only skin where a hand hangs, on its side of the body, for a while."""

    def __init__(self) -> None:
        self._candidates: dict[int, tuple[Floats, float]] = {}

    def update(self, pieces: Sequence[SkinPatch], head: Floats, face: float, seconds: float) -> dict[int, SkinPatch]:
        """All skin patches of a frame -> accepted hanging hands, by side: -1 the picture's left, 1 its right."""
        accepted, candidates = {}, {}
        for side in (-1, 1):
            patches = [p for p in pieces if _hangs((p.centre - head) * (side, 1) / face)]
            if len(patches) != 1:
                continue
            centre = patches[0].centre
            start, since_s = self._candidates.get(side, (centre, 0.0))
            stayed = _distance(start, centre) < TREMBLE * face
            candidates[side] = (start, since_s + seconds) if stayed else (centre, 0.0)
            if candidates[side][1] >= REST_S:
                accepted[side] = patches[0]
        self._candidates = candidates
        return accepted


def _hangs(offset: Floats) -> bool:
    (left, right), (top, bottom) = HANGING
    return bool(left < offset[0] < right and top < offset[1] < bottom)


def _distance(one: Floats, other: Floats) -> float:
    return float(np.hypot(*(one - other)))
