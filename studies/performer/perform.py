"""The synthetic performer's recordings: a kinematic model's movements, NOT recordings of people, seeded throughout.

They show the system at work where no recording of a person is at hand; figures measured on them say nothing about
how well real people are recognised.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording, Span
from observer.tracks import BODY_PARTS, Floats
from studies.performer.body import CHANNELS, assume
from studies.performer.plan import Plan, compose, standing
from studies.performer.repertoire import KNOWN_PEOPLE, SCORES, Person

MOVEMENTS: tuple[str, ...] = tuple(SCORES)
"""The paper's eight labels, in the order of its tables."""

PEOPLE: tuple[str, ...] = tuple(KNOWN_PEOPLE)
"""The four synthetic people."""

SENSOR_NOISE = 0.002
"""Metres, standard deviation of each coordinate: what a good magnetic tracker leaves (section V.A)."""

LEAD_S = (0.02, 0.12)
"""A cut-out recording begins and ends this long before and after its movement."""

# Sizes of idle sway, in the units of the channels: hands, step, side, drop, lean, twist, nod.
SWAY = np.array([0.006, 0.004, 0.008, 0.006, 0.004, 0.008, 0.004, 0.004, 0.0, 0.006, 0.012, 0.015])
SWAY_HZ = (0.1, 0.35)
BREATH_HZ, BREATH_LEAN_RAD, BREATH_DROP = 0.27, 0.004, 0.002

# The first number after the seed of every stream of chance, so that cut-out and continuous never share one.
CUT_OUT, CONTINUOUS = 0, 1


def perform(
    people: Sequence[str] = PEOPLE,
    movements: Sequence[str] = MOVEMENTS,
    trials: int = 4,
    rate_hz: float = 15.0,
    seed: int = 0,
) -> MotionArchive:
    """Synthetic recordings, one a person, movement and trial, cut out: 1.5 to 4 s from rest posture to rest posture.

    Each depends on the seed and on its own person, movement and trial alone: asking for fewer changes none.
    Raises BadInput for a person or movement that is not known, fewer than one trial, a rate that is not
    positive, a negative seed.
    """
    _check(people, movements, rate_hz, seed)
    if trials < 1:
        raise BadInput(f"trials = {trials}: at least one trial of each movement is needed")
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
    """One long synthetic recording: `movements` in their order, named by its spans, idle standing around each.

    rest_s: shortest and longest rest in seconds. Its trials are others than those of `perform`. Raises BadInput
    as `perform` does, and for a rest that is negative or whose shortest is longer than its longest.
    """
    _check([person], movements, rate_hz, seed)
    if not 0.0 <= rest_s[0] <= rest_s[1] < np.inf:
        raise BadInput(f"rest_s = {rest_s}: needs 0 <= shortest <= longest, in seconds")
    who = KNOWN_PEOPLE[person]
    rng = np.random.default_rng((seed, CONTINUOUS, PEOPLE.index(person)))
    begin = standing(who, rng)
    clock = float(rng.uniform(*rest_s))
    plans: list[tuple[float, Plan]] = []
    for movement in movements:
        plans.append((clock, compose(SCORES[movement], who, plans[-1][1].end if plans else begin, rng)))
        clock += plans[-1][1].duration + float(rng.uniform(*rest_s))
    spans = tuple(
        Span(_frame(start, rate_hz), _frame(start + plan.duration, rate_hz), movement)
        for movement, (start, plan) in zip(movements, plans, strict=True)
    )
    positions = _play(who, begin, plans, clock, rate_hz, rng)
    return Recording(positions, rate_hz, "", person, f"continuous-{seed}", spans)


def _cut_out(person: str, movement: str, trial: int, rate_hz: float, seed: int) -> Recording:
    who = KNOWN_PEOPLE[person]
    rng = np.random.default_rng((seed, CUT_OUT, PEOPLE.index(person), MOVEMENTS.index(movement), trial))
    begin = standing(who, rng)
    before, after = rng.uniform(*LEAD_S, size=2)
    plan = compose(SCORES[movement], who, begin, rng)
    positions = _play(who, begin, [(before, plan)], before + plan.duration + after, rate_hz, rng)
    return Recording(positions, rate_hz, movement, person, str(trial))


def _play(
    who: Person,
    begin: Floats,
    plans: Sequence[tuple[float, Plan]],
    duration: float,
    rate_hz: float,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """(F, 3, 3) what a sensor sees of the person who carries out the plans, each from its own second on."""
    time = np.arange(_frame(duration, rate_hz)) / rate_hz
    postures = begin + _idle(time, who, rng)
    for start, plan in plans:
        postures += plan.displacement(time - start)
    positions = assume(who.build, postures).positions
    return (positions + rng.normal(0.0, SENSOR_NOISE, positions.shape)).astype(np.float32)


def _idle(time: Floats, who: Person, rng: np.random.Generator) -> Floats:
    """(T, 12) breathing and slow sway, of which every channel has its own frequency and phase."""
    frequency = rng.uniform(*SWAY_HZ, size=CHANNELS)
    phase_rad = rng.uniform(0.0, 2 * np.pi, size=CHANNELS)
    idle: Floats = who.sway * SWAY * np.sin(2 * np.pi * time[:, None] * frequency + phase_rad)
    breath = np.sin(2 * np.pi * (BREATH_HZ * who.tempo * time + rng.random()))
    idle[:, 8] -= BREATH_DROP * breath
    idle[:, 9] -= BREATH_LEAN_RAD * breath
    return idle


def _frame(time: float, rate_hz: float) -> int:
    """The first frame at or after `time` seconds."""
    return int(np.ceil(time * rate_hz))


def _check(people: Sequence[str], movements: Sequence[str], rate_hz: float, seed: int) -> None:
    for person in people:
        if person not in KNOWN_PEOPLE:
            raise BadInput(f"person {person!r}: not one of the synthetic people; known: {', '.join(PEOPLE)}")
    for movement in movements:
        if movement not in SCORES:
            raise BadInput(f"movement {movement!r}: not in the synthetic repertoire; known: {', '.join(MOVEMENTS)}")
    if not 0.0 < rate_hz < np.inf:
        raise BadInput(f"rate_hz = {rate_hz}: frames a second, needs to be above 0")
    if seed < 0:
        raise BadInput(f"seed = {seed}: needs to be 0 or above")
