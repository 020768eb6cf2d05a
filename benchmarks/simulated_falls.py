"""The synthetic performer falls, ties shoes, squats, sits down on the floor: SIMULATED, not recordings. Seeded, pure.

Whole bodies, because the watch for falls needs legs. A fall is either that of a stiff body about its feet, which gets
ever faster, or a collapse: the legs give way, then the torso topples. Both end on the floor.
"""

import math
from dataclasses import dataclass

import numpy as np

from observer.motion.archive import Recording
from observer.tracks import WHOLE_BODY, Floats, Integers
from studies.performer.body import Build, assume
from studies.performer.perform import SENSOR_NOISE, minimum_jerk, standing
from studies.performer.repertoire import KNOWN_PEOPLE

DIRECTIONS_DEG = tuple(range(0, 360, 45))
"""0 is forward, 90 to the performer's left."""
STAND_S, LIE_S = 2.0, 4.0
FAST_S, SLOW_S = 0.8, 2.5
"""From the first lean until the body lies; a stiff body that falls freely takes about a second."""
HIP_SHARE, THIGH_SHARE, FOOT_M = 0.5, 0.462, 0.05
"""Half the hips' width as a share of half the shoulders', the thigh as a share of the leg, and the foot's height."""
EVERYDAY = {
    "tie_shoes_kneeling": (60, 0.53),
    "tie_shoes_crouching": (60, 0.27),
    "squat": (35, 0.3),
    "sit_on_floor": (-10, 0.1),
    "pick_up": (95, 0.95),
}
"""Lean of the torso in degrees, and the height of the hips as a share of the leg."""
_UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, slots=True)
class SimulatedFall:
    """begins_s: of the first lean; lies_s: when the body lies."""

    recording: Recording
    begins_s: float
    lies_s: float


def fall(person: str, direction_deg: float, slow: bool, rate_hz: float = 30.0, seed: int = 0) -> SimulatedFall:
    """A person of `repertoire.KNOWN_PEOPLE` stands, falls in a direction, and lies."""
    fall_s = SLOW_S if slow else FAST_S
    time = np.arange(round((STAND_S + fall_s + LIE_S) * rate_hz)) / rate_hz
    share = np.clip((time - STAND_S) / fall_s, 0.0, 1.0)
    body = _standing(person, len(time), seed)
    angle, towards = math.radians(direction_deg), np.zeros(3)
    towards[[0, 2]] = -math.sin(angle), -math.cos(angle)
    if slow:
        _collapse(body, KNOWN_PEOPLE[person].build, share, towards)
    else:
        _topple(body, _rows(WHOLE_BODY), np.zeros(3), share**2 * np.pi / 2, towards)
    name = f"fall_{'slowly' if slow else 'fast'}"
    return SimulatedFall(_recorded(body, rate_hz, name, person, seed), STAND_S, STAND_S + fall_s)


def everyday(person: str, what: str, rate_hz: float = 30.0, seed: int = 0) -> Recording:
    """One of EVERYDAY, which bring the body down without a fall, and hold it there for LIE_S seconds."""
    build = KNOWN_PEOPLE[person].build
    time = np.arange(round((2 * STAND_S + LIE_S) * rate_hz)) / rate_hz
    share = minimum_jerk(time - STAND_S + 1.0) - minimum_jerk(time - STAND_S - LIE_S)
    lean_deg, hips = EVERYDAY[what]
    body = _standing(person, len(time), seed)
    _lower(body, build, 1 - share * (1 - hips), knees_forward=0.0 if what == "pick_up" else 1.0)
    lean = share * math.radians(lean_deg)
    _topple(body, _rows(_torso_parts()), body[:, _rows(("pelvis",))[0]], lean, -_UP[[0, 2, 1]])
    # Whoever does not fall keeps the torso over the feet, so the hips go back.
    above = _rows(tuple(part for part in WHOLE_BODY if not part.endswith(("_knee", "_foot"))))
    body[:, above, 2] += (build.trunk / 2 * np.sin(lean))[:, None]
    return _recorded(body, rate_hz, what, person, seed)


def _standing(person: str, frames: int, seed: int) -> Floats:
    """(F, 15, 3) a person at rest, feet on the floor at the origin."""
    performer = KNOWN_PEOPLE[person]
    build = performer.build
    rest = standing(performer, np.random.default_rng((seed, 7)))
    skeleton = assume(build, np.repeat(rest[None], frames, axis=0))
    leg = build.leg - FOOT_M
    neck = skeleton.shoulders.mean(axis=1)
    body = np.empty((frames, len(WHOLE_BODY), 3))
    for side, (name, sign) in enumerate((("left", -1.0), ("right", 1.0))):
        hip = skeleton.hips + sign * HIP_SHARE * build.half_shoulders * np.array([1.0, 0.0, 0.0])
        knee, foot = hip - THIGH_SHARE * leg * _UP, hip - leg * _UP
        arm = (skeleton.hands[:, side], skeleton.elbows[:, side], skeleton.shoulders[:, side])
        names = tuple(f"{name}_{part}" for part in ("hand", "elbow", "shoulder", "hip", "knee", "foot"))
        body[:, _rows(names)] = np.stack([*arm, hip, knee, foot], axis=1)
    body[:, _rows(("head", "neck", "pelvis"))] = np.stack([skeleton.head, neck, skeleton.hips], axis=1)
    return body


def _collapse(body: Floats, build: Build, share: Floats, towards: Floats) -> None:
    """The legs give way in the first two thirds, the torso topples in the last two."""
    _lower(body, build, 1 - 0.88 * minimum_jerk(share * 1.5), knees_forward=1.0)
    lean = minimum_jerk((share - 1 / 3) * 1.5) * np.pi / 2
    _topple(body, _rows(_torso_parts()), body[:, _rows(("pelvis",))[0]], lean, towards)


def _lower(body: Floats, build: Build, hips: Floats, knees_forward: float) -> None:
    """Bring the hips to (F,) shares of their height; the knees go where two links of the leg's lengths put them."""
    leg = build.leg - FOOT_M
    thigh, shin = THIGH_SHARE * leg, (1 - THIGH_SHARE) * leg
    height = np.maximum(hips * leg, abs(shin - thigh) + 0.01)
    along = (shin**2 - thigh**2 + height**2) / (2 * height)
    ahead = np.sqrt(np.maximum(shin**2 - along**2, 0.0))
    moved = [part for part in WHOLE_BODY if not part.endswith(("_knee", "_foot"))]
    body[:, _rows(tuple(moved)), 1] -= (leg - height)[:, None]
    for knee in _rows(("left_knee", "right_knee")):
        body[:, knee, 1] = FOOT_M + along
        body[:, knee, 2] -= knees_forward * ahead


def _topple(body: Floats, rows: Integers, pivot: Floats, angle: Floats, towards: Floats) -> None:
    """Turn these parts by (F,) radians about a pivot, from upright to `towards` (Rodrigues' formula)."""
    axis = np.cross(_UP, towards)
    offset = body[:, rows] - np.broadcast_to(pivot, (len(body), 3))[:, None]
    cos, sin = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    turned = offset * cos + np.cross(axis, offset) * sin + axis * (offset @ axis)[..., None] * (1 - cos)
    body[:, rows] = turned + np.broadcast_to(pivot, (len(body), 3))[:, None]


def _torso_parts() -> tuple[str, ...]:
    return tuple(
        part for part in WHOLE_BODY if part.endswith(("hand", "elbow", "shoulder")) or part in ("head", "neck")
    )


def _rows(parts: tuple[str, ...]) -> Integers:
    return np.array([WHOLE_BODY.index(part) for part in parts])


def _recorded(body: Floats, rate_hz: float, label: str, person: str, seed: int) -> Recording:
    noise = np.random.default_rng((seed, 8)).normal(0.0, SENSOR_NOISE, body.shape)
    return Recording((body + noise).astype(np.float32), rate_hz, label, person, str(seed))
