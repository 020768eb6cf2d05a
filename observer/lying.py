"""Whether a person lies, from the parts of one camera: the evidence of the watch for falls. Pure.

Lengths in the image tell it, as multiples of the standing torso: how far the shoulders or the head are above the hips,
the hips above the feet, and the head from the feet (docs/design/falls.md).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from common import SECOND_NS
from observer.body import SHRINK_STILL_S, TORSO_LENGTHS, BodyReach
from observer.tracks import Floats

THIGH, SHIN = 1 / TORSO_LENGTHS["left_hip", "left_knee"], 1 / TORSO_LENGTHS["left_knee", "left_foot"]
"""Torso lengths."""
LEG = THIGH + SHIN
HEAD_ABOVE_PELVIS = TORSO_LENGTHS["head", "pelvis"]
UPRIGHT_COSINE = math.cos(math.radians(30))
"""Of a torso that leans by less than 30 degrees the length is measured."""
LONG_LEG = 1.25
"""A leg that is so much longer than the torso's length says is that of somebody who leans towards the camera."""
BORDER_WIDTH = 0.1
"""Torso lengths by which the points of trackers are wrong: the width of these borders."""
SMOOTH_S = 0.15
"""Time constant of the evidence, so that one false frame is none."""
GAP_S = 1.0
"""After so long without sight of the person the evidence begins anew."""
_SIDES = ("left", "right")


@dataclass(frozen=True, slots=True)
class LyingBorders:
    """Where somebody is as likely to lie as not; `python -m benchmarks.fall_borders` moves them.

    lean_deg: of the torso from upright. height: of the hips, as a share of the leg: half is the height of a chair.
    aside, above: torso lengths of the head from the feet, at least so far aside or, seen along the body, at most so far
    above. Somebody who crouches or kneels with the torso leaning by 60 degrees has it at most 1.3 aside and at least
    1.3 above; people on the floor of a room, seen from the side, have it at least 1.7 aside (docs/results/falls.md).
    """

    lean_deg: float = 50.0
    height: float = 0.5
    aside: float = 1.5
    above: float = 1.0


class LyingReader:
    """Reads P(the person lies) from a stream of tracks.

    body_parts: names of the P parts, in the order of the rows.
    """

    def __init__(self, body_parts: Sequence[str], borders: LyingBorders | None = None) -> None:
        self._borders = borders = borders or LyingBorders()
        self._steep, self._low = math.cos(math.radians(borders.lean_deg)), LEG * borders.height
        self._body_parts, row = tuple(body_parts), {part: n for n, part in enumerate(body_parts)}
        self._head = row.get("head")
        self._shoulders = [row[part] for part in ("left_shoulder", "right_shoulder") if part in row]
        self._hips = [row[part] for part in ("left_hip", "right_hip") if part in row]
        self._shoulders = self._shoulders or [row[part] for part in ("neck",) if part in row]
        self._hips = self._hips or [row[part] for part in ("pelvis",) if part in row]
        self._feet = [row[f"{side}_foot"] for side in _SIDES if f"{side}_foot" in row]
        self._knees = [row[f"{side}_knee"] for side in _SIDES if f"{side}_knee" in row]
        self._reach = BodyReach(body_parts) if self.can_tell else None
        self._size = math.nan
        self._p = math.nan
        self._at_ns = 0

    @property
    def can_tell(self) -> bool:
        """Whether the tracker has the parts that are needed: shoulder or neck, hip or pelvis, and knee or foot."""
        return bool(self._shoulders and self._hips and (self._feet or self._knees))

    def update(self, centres: Floats, at_ns: int) -> float | None:
        """(P, 2) centres, v down, NaN where not seen, of the frame at `at_ns` -> 0 to 1; None: not seen well enough."""
        if self._reach is None:
            return None
        rows = centres.tolist()
        shoulders, hips = _height(rows, self._shoulders), _height(rows, self._hips)
        below = [_lowest(rows, self._feet), _lowest(rows, self._knees)]
        if math.isnan(shoulders) or math.isnan(hips) or all(map(math.isnan, below)):
            return None
        passed_s = (at_ns - self._at_ns) / SECOND_NS
        self._at_ns = at_ns
        is_new = math.isnan(self._p) or not 0 <= passed_s <= GAP_S
        if is_new:
            self._size, self._p = math.nan, math.nan
            self._reach = BodyReach(self._body_parts)
        head = math.nan if self._head is None else rows[self._head][1]
        rise = hips - shoulders if math.isnan(head) else max(hips - shoulders, (hips - head) * HEAD_ABOVE_PELVIS)
        foot, knee = below[0] - hips, below[1] - hips
        # Of a leg of which only the knee is seen, the shin is taken to go on like the thigh.
        leg = knee * LEG / THIGH if math.isnan(foot) else foot if math.isnan(knee) else max(foot, knee)
        size = self._update_size(self._reach.update(centres), rise, leg, passed_s)
        if not size > 0:
            return None
        margin = min(self._steep - rise / size, self._low - leg / size, self._stretched_or_flat(rows, size))
        p = _sigmoid(margin / BORDER_WIDTH)
        self._p = p if is_new else self._p + (p - self._p) * (1 - math.exp(-passed_s / SMOOTH_S))
        return self._p

    def _stretched_or_flat(self, rows: Sequence[Sequence[float]], size: float) -> float:
        """By how much the head is aside of the feet, or not above them; negative if it is neither.

        Infinite where head or feet are not seen.
        """
        feet = [rows[foot] for foot in self._feet if not math.isnan(rows[foot][1])]
        if self._head is None or not feet or math.isnan(rows[self._head][1]):
            return math.inf
        aside = sum(foot[0] for foot in feet) / len(feet) - rows[self._head][0]
        above = sum(foot[1] for foot in feet) / len(feet) - rows[self._head][1]
        return max(abs(aside) / size - self._borders.aside, self._borders.above - above / size)

    def _update_size(self, reach: float, rise: float, leg: float, passed_s: float) -> float:
        """The torso's length: a larger reach is taken at once, a smaller one only of somebody upright.

        Who lies towards the camera looks short, and would look upright by the length that is seen then.
        """
        if math.isnan(self._size) or reach > self._size:
            self._size = reach
        elif rise > UPRIGHT_COSINE * reach and leg < LONG_LEG * LEG * reach:
            self._size += (reach - self._size) * (1 - math.exp(-passed_s / SHRINK_STILL_S))
        return self._size


def _height(rows: Sequence[Sequence[float]], parts: Sequence[int]) -> float:
    """The mean v of those of the parts that are seen; NaN if none is."""
    seen = [rows[part][1] for part in parts if not math.isnan(rows[part][1])]
    return sum(seen) / len(seen) if seen else math.nan


def _lowest(rows: Sequence[Sequence[float]], parts: Sequence[int]) -> float:
    """The largest v of the parts; NaN if none is seen."""
    return max((rows[part][1] for part in parts if not math.isnan(rows[part][1])), default=math.nan)


def _sigmoid(value: float) -> float:
    return 1 / (1 + math.exp(-min(max(value, -50.0), 50.0)))
