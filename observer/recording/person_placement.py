"""Where a person stands and faces, from triangulated tracks. Pure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.errors import BadInput
from observer.geometry.placement import PersonPlacement, facing_of
from observer.recording.reconstruction import CameraTracks, remove_spikes
from observer.recording.triangulation import Progress, reconstruct_parts
from observer.tracks import Floats

PLACING_HZ = 10.0
"""Instants a second: a person who stands does not move between two of them."""
SHOULDERS_AND_HIPS = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
"""The parts whose line from left to right a person faces across; without them the hands must do."""
HANDS = ("left_hand", "right_hand")
LEAST_UPRIGHT_SHARE = 0.7
"""Least share of the way from the hips to the head that is along y; less is a room whose y does not point up."""
STEADY_DEG = 20.0
"""Spread of the facing beyond which the person turned, or the trackers confuse left and right."""
FEW_HEADS_SHARE = 0.5
"""A place rests on too little if the head was seen in a smaller share of the instants."""


@dataclass(frozen=True, slots=True)
class SeenPerson:
    """What the cameras see of a person who stands. placement: median place and height of the head, mean facing.

    head_seen, sides_seen: shares of the instants with the head, and with a line from left to right. spread_deg:
    circular standard deviation of the facing. by_hands: the facing rests on the hands, because no trunk was seen.
    error_px: median reprojection error.
    """

    placement: PersonPlacement
    head_seen: float
    sides_seen: float
    spread_deg: float
    by_hands: bool
    error_px: float

    @property
    def doubts(self) -> list[str]:
        """Why the result may be wrong, each with a remedy."""
        doubts = []
        if self.head_seen < FEW_HEADS_SHARE:
            doubts.append(
                f"the head was found in {self.head_seen:.0%} of the time: stand where all cameras see you whole"
            )
        if self.by_hands:
            doubts.append("the facing is that of the hands: let them hang at your sides, or use the tracker mediapipe")
        if self.spread_deg > STEADY_DEG:
            doubts.append(f"the facing varied by {self.spread_deg:.0f} degrees: stand still, facing as you will")
        return doubts


def seen_person(
    tracks: Sequence[CameraTracks],
    body_parts: Sequence[str],
    rate_hz: float,
    gate_px: float | None = None,
    progress: Progress = lambda *_: None,
) -> SeenPerson:
    """The person whom calibrated cameras see; tracks: of these body parts, among them the head.

    Raises BadInput when the cameras have no common time, never agree on the head or on left and right, and when the
    person is not upright along y.
    """
    result = reconstruct_parts(tracks, body_parts, rate_hz, gate_px, progress).result
    positions = remove_spikes(result.positions, rate_hz)
    head = positions[:, list(body_parts).index("head")]
    if not np.isfinite(head).any():
        raise BadInput("the cameras never agree on the head: labanmesh camera look shows what each tracker finds")
    across = _across(positions, body_parts, SHOULDERS_AND_HIPS)
    by_hands = not len(across)
    across = _across(positions, body_parts, HANDS) if by_hands else across
    if not len(across):
        raise BadInput("the cameras never agree on left and right: labanmesh camera look shows what each tracker finds")
    _require_upright(positions, body_parts)
    x, y, z = np.nanmedian(head, axis=0)
    facing_deg, spread_deg = _facing(across)
    errors = result.errors_px[result.inliers]
    return SeenPerson(
        PersonPlacement(float(x), float(z), float(y), facing_deg),
        float(np.isfinite(head).all(axis=1).mean()),
        len(across) / len(positions),
        spread_deg,
        by_hands,
        float(np.median(errors)),
    )


def _across(positions: Floats, body_parts: Sequence[str], names: Sequence[str]) -> Floats:
    """(K, P, 3), and left and right parts in pairs -> (at most K, 3) sums of their lines, where one is known."""
    rows = {part: row for row, part in enumerate(body_parts)}
    lines = np.full((len(names) // 2, len(positions), 3), np.nan)
    for n, (left, right) in enumerate(zip(names[::2], names[1::2], strict=True)):
        if left in rows and right in rows:
            lines[n] = positions[:, rows[right]] - positions[:, rows[left]]
    known = np.logical_or.reduce(np.isfinite(lines[..., 0]), axis=0)
    result: Floats = np.nansum(lines, axis=0)[known]
    return result


def _facing(across: Floats) -> tuple[float, float]:
    """(K, 3) lines from left to right -> mean facing and circular standard deviation, degrees.

    Each line counts as one direction, however long it is: a line that is too long is an error.
    """
    angles = np.array([math.radians(facing_of(line)) for line in across])
    mean = complex(np.exp(1j * angles).mean())
    spread = math.sqrt(max(-2 * math.log(max(abs(mean), 1e-9)), 0.0))
    return math.degrees(math.atan2(mean.imag, mean.real)), math.degrees(spread)


def _require_upright(positions: Floats, body_parts: Sequence[str]) -> None:
    """Raise BadInput if the head is not above the hips along y; says nothing where hips are not seen."""
    rows = [row for row, part in enumerate(body_parts) if part in SHOULDERS_AND_HIPS[2:]]
    if not rows:
        return
    hips = positions[:, rows].mean(axis=1)
    trunk = positions[:, list(body_parts).index("head")] - hips
    known = trunk[np.isfinite(trunk).all(axis=1)]
    if len(known):
        line = np.median(known, axis=0)
        if line[1] < LEAST_UPRIGHT_SHARE * np.linalg.norm(line):
            raise BadInput(
                "the head is not above the hips along y: stand upright; if y does not point up in this room, make "
                "camera files in which it does: labanmesh camera calibrate --read FILE --up z"
            )
