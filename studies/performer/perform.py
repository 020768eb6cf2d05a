"""Synthetic recordings by a kinematic model, NOT recordings of people. Seeded, pure.

They demonstrate the system without recordings of people; results on them say nothing about the recognition of real
people.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording, Span
from observer.tracks import BODY_PARTS, Floats
from studies.performer.body import CHANNELS, assume
from studies.performer.plan import MotionPlan, compose, standing
from studies.performer.repertoire import KNOWN_PEOPLE, SCORES, Person

MOVEMENTS: tuple[str, ...] = tuple(SCORES)
"""The paper's eight labels, in the order of its tables."""

PEOPLE: tuple[str, ...] = tuple(KNOWN_PEOPLE)
"""The four synthetic people."""

SENSOR_NOISE = 0.002
"""Standard deviation of each coordinate in metres: that of a good magnetic tracker (section V.A)."""

LEAD_S = (0.02, 0.12)
"""A cut-out recording begins and ends this long before and after its movement."""

# Sizes of idle sway, in the units of the channels: hands, step, side, drop, lean, twist, nod.
SWAY = np.array([0.006, 0.004, 0.008, 0.006, 0.004, 0.008, 0.004, 0.004, 0.0, 0.006, 0.012, 0.015])
SWAY_HZ = (0.1, 0.35)
BREATH_HZ, BREATH_LEAN_RAD, BREATH_DROP = 0.27, 0.004, 0.002

# Part of every seed, so that cut-out and continuous recordings never share random numbers.
CUT_OUT, CONTINUOUS = 0, 1


def perform(
    people: Sequence[str] = PEOPLE,
    movements: Sequence[str] = MOVEMENTS,
    trials: int = 4,
    rate_hz: float = 15.0,
    seed: int = 0,
) -> MotionArchive:
    """One synthetic recording per person, movement and trial: 1.5 to 4 s from rest posture to rest posture.

    Each depends only on the seed, person, movement and trial: requesting fewer changes none. Raises BadInput for an
    unknown person or movement, fewer than one trial, a rate that is not positive, a negative seed.
    """
    _check(people, movements, rate_hz, seed)
    if trials < 1:
        raise BadInput(f"trials = {trials}: needs at least 1")
    recordings = tuple(
        _cut_out(person, movement, trial, rate_hz, seed)
        for person in people
        for movement in movements
        for trial in range(1, trials + 1)
    )
    return MotionArchive(BODY_PARTS, recordings)


def perform_continuously(
    person: str,
    movements: Sequence[str],
    rate_hz: float = 15.0,
    seed: int = 0,
    rest_s: tuple[float, float] = (1.0, 1.6),
) -> Recording:
    """One long synthetic recording: `movements` in order, as spans, with rest around each.

    rest_s: shortest and longest rest in seconds. The trials differ from those of `perform`. Raises BadInput as
    `perform` does, and for a negative rest or a shortest rest above the longest.
    """
    _check([person], movements, rate_hz, seed)
    if not 0.0 <= rest_s[0] <= rest_s[1] < np.inf:
        raise BadInput(f"rest_s = {rest_s}: needs 0 <= shortest <= longest, in seconds")
    performer = KNOWN_PEOPLE[person]
    rng = np.random.default_rng((seed, CONTINUOUS, PEOPLE.index(person)))
    begin = standing(performer, rng)
    clock = float(rng.uniform(*rest_s))
    plans: list[tuple[float, MotionPlan]] = []
    for movement in movements:
        plans.append((clock, compose(SCORES[movement], performer, plans[-1][1].end if plans else begin, rng)))
        clock += plans[-1][1].duration + float(rng.uniform(*rest_s))
    spans = tuple(
        Span(_frame(start, rate_hz), _frame(start + plan.duration, rate_hz), movement)
        for movement, (start, plan) in zip(movements, plans, strict=True)
    )
    positions = _play(performer, begin, plans, clock, rate_hz, rng)
    return Recording(positions, rate_hz, "", person, f"continuous-{seed}", spans)


def _cut_out(person: str, movement: str, trial: int, rate_hz: float, seed: int) -> Recording:
    performer = KNOWN_PEOPLE[person]
    rng = np.random.default_rng((seed, CUT_OUT, PEOPLE.index(person), MOVEMENTS.index(movement), trial))
    begin = standing(performer, rng)
    before, after = rng.uniform(*LEAD_S, size=2)
    plan = compose(SCORES[movement], performer, begin, rng)
    positions = _play(performer, begin, [(before, plan)], before + plan.duration + after, rate_hz, rng)
    return Recording(positions, rate_hz, movement, person, str(trial))


def _play(
    performer: Person,
    begin: Floats,
    plans: Sequence[tuple[float, MotionPlan]],
    duration: float,
    rate_hz: float,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """(F, 3, 3) sensor positions of a person who carries out the plans, each from its start in seconds."""
    time = np.arange(_frame(duration, rate_hz)) / rate_hz
    postures = begin + _idle(time, performer, rng)
    for start, plan in plans:
        postures += plan.displacement(time - start)
    positions = assume(performer.build, postures).positions
    return (positions + rng.normal(0.0, SENSOR_NOISE, positions.shape)).astype(np.float32)


def _idle(time: Floats, performer: Person, rng: np.random.Generator) -> Floats:
    """(T, 12) breathing and slow sway; every channel has its own frequency and phase."""
    frequency = rng.uniform(*SWAY_HZ, size=CHANNELS)
    phase_rad = rng.uniform(0.0, 2 * np.pi, size=CHANNELS)
    idle: Floats = performer.sway * SWAY * np.sin(2 * np.pi * time[:, None] * frequency + phase_rad)
    breath = np.sin(2 * np.pi * (BREATH_HZ * performer.tempo * time + rng.random()))
    idle[:, 8] -= BREATH_DROP * breath
    idle[:, 9] -= BREATH_LEAN_RAD * breath
    return idle


def _frame(time: float, rate_hz: float) -> int:
    """The first frame at or after `time` seconds."""
    return int(np.ceil(time * rate_hz))


def _check(people: Sequence[str], movements: Sequence[str], rate_hz: float, seed: int) -> None:
    for person in people:
        if person not in KNOWN_PEOPLE:
            raise BadInput(f"person {person!r}: no synthetic person; known: {', '.join(PEOPLE)}")
    for movement in movements:
        if movement not in SCORES:
            raise BadInput(f"movement {movement!r}: not in the synthetic repertoire; known: {', '.join(MOVEMENTS)}")
    if not 0.0 < rate_hz < np.inf:
        raise BadInput(f"rate_hz = {rate_hz}: frames per second, must be above 0")
    if seed < 0:
        raise BadInput(f"seed = {seed}: must be 0 or above")
