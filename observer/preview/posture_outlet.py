"""Whether a person lies, from the parts of one camera, as an observer publishes it for the watch for falls.

Lengths in the image tell it, as multiples of the standing torso: how far the shoulders or the head are above the hips,
the hips above the feet, and the head from the feet (docs/design/falls.md).
"""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from common import SECOND_NS
from common.config_watch import Area
from common.fall_messages import TRACKS_LIMIT, PostureMessage
from common.subsession import Publisher
from common.wire import encode
from observer.body import SHRINK_STILL_S, TORSO_LENGTHS, BodyReach
from observer.preview.small_picture import Sighting
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
        p = 1 / (1 + math.exp(-min(max(margin / BORDER_WIDTH, -50.0), 50.0)))
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


HEARTBEAT_NS = SECOND_NS // 2
MOST_CHANGE = 0.05
"""The evidence is published when it has changed by so much, and every HEARTBEAT_NS."""
THE_PERSON = ""
"""The track of an observer that follows one person."""
HIPS = ("left_hip", "right_hip", "pelvis")
CANNOT_TELL = (
    "watch.fallen: the tracker of this observer finds no torso and legs, so it takes no part in the watch; use a "
    'tracker with a pose model (tracker = "mediapipe")'
)

log = logging.getLogger("labanmesh.observer")


class PostureOutlet:
    """Takes every sighting. areas: where people usually lie; a person with the hips there does not count as lying."""

    def __init__(self, publisher: Publisher, areas: Sequence[Area] = ()) -> None:
        self._publisher, self._areas = publisher, areas
        self._readers: dict[str, LyingReader] = {}
        self._can_tell: bool | None = None
        self._hips: list[int] = []
        self._sent_ns = 0
        self._sent: dict[str, float] = {}

    def is_due(self, now_ns: int) -> bool:
        """Always: a fall is short."""
        return True

    def show(self, sighting: Sighting, now_ns: int) -> None:
        """Read one frame; raises LabanmeshError if the link is closed."""
        if self._can_tell is None:
            self._can_tell = LyingReader(sighting.body_parts).can_tell
            self._hips = [row for row, part in enumerate(sighting.body_parts) if part in HIPS]
            if not self._can_tell:
                log.warning(CANNOT_TELL)
        if not self._can_tell:
            return
        tracks = sighting.tracks
        several = {str(person.id): person.centres for person in tracks.persons}
        lying = self._lying(several or {THE_PERSON: tracks.centres}, sighting)
        changed = lying.keys() != self._sent.keys() or any(
            abs(p - self._sent[track]) >= MOST_CHANGE for track, p in lying.items()
        )
        if changed or not 0 <= sighting.captured_ns - self._sent_ns < HEARTBEAT_NS:
            self._sent_ns, self._sent = sighting.captured_ns, lying
            message = PostureMessage(
                captured_ns=sighting.captured_ns,
                lying=max(lying.values(), default=None),
                people=dict(list(lying.items())[:TRACKS_LIMIT]) if several else None,
            )
            self._publisher.put(encode(message))

    def _lying(self, people: Mapping[str, Floats], sighting: Sighting) -> dict[str, float]:
        """P(lying) of those who are seen well enough, by track."""
        self._readers = {
            track: self._readers.get(track) or LyingReader(sighting.body_parts) for track in people
        }  # fmt: skip
        known = {}
        for track, centres in people.items():
            p = self._readers[track].update(centres, sighting.captured_ns)
            if p is not None:
                known[track] = 0.0 if self._areas and self._is_left_out(centres, sighting) else p
        return known

    def _is_left_out(self, centres: Floats, sighting: Sighting) -> bool:
        hips = centres[self._hips]
        hips = hips[np.isfinite(hips[:, 0])]
        if not len(hips):
            return False
        u, v = hips.mean(axis=0)
        if sighting.picture is not None:
            height, width = sighting.picture.shape[:2]
            u, v = u / width, v / height
        return any(left <= u <= right and top <= v <= bottom for left, top, right, bottom in self._areas)
