"""Synthetic recordings by a kinematic model, NOT recordings of people. Seeded, pure.

They demonstrate the system without recordings of people; results on them say nothing about the recognition of real
people.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording, Span
from observer.tracks import BODY_PARTS, Floats
from studies.performer.body import LEFT, MOTION_CHANNELS, RIGHT, Posture, assume
from studies.performer.repertoire import KNOWN_PEOPLE, SCORES, Hold, Person, Score, Stroke, Swing

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

# Variation between trials: standard deviations, cut off at two of them (Chance.about).
TEMPO, AMPLITUDE, STROKE_TIME, SWING_SIZE = 0.04, 0.05, 0.05, 0.12  # factors, around 1
REACH_JITTER, REST_JITTER = 0.035, 0.015  # arm lengths
PHASE_JITTER_RAD = 0.45
FLIPPED = 0.25  # share of the swings that begin on the other side
CYCLES_CHANGED = (-0.5, 0.0, 0.0, 0.5)

LATE_CHANNELS = np.array([1, 0, 1, 1, 0, 1, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5])  # all but the hands' height, see Person.curl


@dataclass(frozen=True, slots=True)
class Chance:
    """Seeded normal draws within two standard deviations."""

    rng: np.random.Generator

    def about(self, deviation: float, size: int | None = None) -> Floats:
        """() or (size,) normal draws around 0."""
        return deviation * np.clip(self.rng.normal(size=size), -2.0, 2.0)

    def factor(self, deviation: float) -> float:
        """One draw around 1."""
        return float(1.0 + self.about(deviation))


@dataclass(frozen=True, slots=True)
class TimedStroke:
    """A minimum-jerk displacement by `change` (12,) from `start`, for `duration` seconds."""

    start: float
    duration: float
    change: Floats
    attack: float
    curl: float

    def displacement(self, time: Floats) -> Floats:
        """(T, 12) at (T,) seconds: 0 before, `change` afterwards."""
        share = ((time - self.start) / self.duration)[:, None]
        late = LATE_CHANNELS if self.curl >= 0 else 1 - LATE_CHANNELS
        done = np.clip(share * (1 + abs(self.curl)) - abs(self.curl) * late, 0.0, 1.0)
        moved: Floats = minimum_jerk(done**self.attack) * self.change
        return moved


@dataclass(frozen=True, slots=True)
class TimedSwing:
    """An oscillation from `start` of `duration` seconds swelling and fading within half a cycle; amplitudes (12,)."""

    start: float
    duration: float
    frequency: float
    phase_rad: float
    sine: Floats
    cosine: Floats
    double: Floats

    def displacement(self, time: Floats) -> Floats:
        """(T, 12) at (T,) seconds: 0 before and afterwards."""
        since = (time - self.start)[:, None]
        ramp = 0.5 / self.frequency
        swell = minimum_jerk(since / ramp) * minimum_jerk((self.duration - since) / ramp)
        angle = 2 * np.pi * self.frequency * since + self.phase_rad
        swung: Floats = self.sine * np.sin(angle) + self.cosine * np.cos(angle) + self.double * np.cos(2 * angle)
        return swell * swung


@dataclass(frozen=True, slots=True)
class MotionPlan:
    """One trial: from the posture `begin` (12,) through its parts to `end` (12,), in `duration` seconds."""

    begin: Floats
    end: Floats
    duration: float
    parts: tuple[TimedStroke | TimedSwing, ...]

    def displacement(self, time: Floats) -> Floats:
        """(T, 12) away from `begin` at (T,) seconds from the plan's start; before it 0, afterwards end - begin."""
        return sum((part.displacement(time) for part in self.parts), np.zeros((len(time), MOTION_CHANNELS)))


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
    postures = begin + idle(time, performer, rng)
    for start, plan in plans:
        postures += plan.displacement(time - start)
    positions = assume(performer.build, postures).positions
    return (positions + rng.normal(0.0, SENSOR_NOISE, positions.shape)).astype(np.float32)


def idle(time: Floats, performer: Person, rng: np.random.Generator) -> Floats:
    """(T, 12) breathing and slow sway; every channel has its own frequency and phase."""
    frequency = rng.uniform(*SWAY_HZ, size=MOTION_CHANNELS)
    phase_rad = rng.uniform(0.0, 2 * np.pi, size=MOTION_CHANNELS)
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


def minimum_jerk(share: Floats) -> Floats:
    """The smoothest path from 0 to 1 (Flash and Hogan 1985): 10 s³ - 15 s⁴ + 6 s⁵, s clipped to [0, 1]."""
    s = np.clip(share, 0.0, 1.0)
    way: Floats = s**3 * (10 + s * (6 * s - 15))
    return way


def standing(person: Person, rng: np.random.Generator) -> Floats:
    """(12,) the person's resting posture in this trial."""
    posture = person.rest_posture
    posture[:6] += Chance(rng).about(REST_JITTER, 6)
    return posture


def compose(score: Score, person: Person, begin: Floats, rng: np.random.Generator) -> MotionPlan:
    """One trial of `score` by `person` from the posture `begin` (12,); all random numbers are drawn here."""
    chance = Chance(rng)
    tempo = person.tempo * chance.factor(TEMPO)
    size = chance.factor(AMPLITUDE)
    end = standing(person, rng)
    clock, now = 0.0, begin
    parts: list[TimedStroke | TimedSwing] = []
    for element in score:
        if isinstance(element, Hold):
            clock += element.seconds * chance.factor(STROKE_TIME) / tempo
            continue
        start = max(clock - element.overlap / tempo, 0.0)
        if isinstance(element, Stroke):
            goal = end if element is score[-1] else _goal(element.posture, person, size, begin, chance)
            seconds = element.seconds * chance.factor(STROKE_TIME) / tempo
            part = TimedStroke(start, seconds / person.sharpness, goal - now, person.attack, person.curl)
            now, clock = goal, start + seconds
            parts.append(part)
        else:
            swing = _swing(element, person, size, start, tempo, chance)
            clock = start + swing.duration
            parts.append(swing)
    return MotionPlan(begin, end, clock, tuple(parts))


def _goal(posture: Posture, person: Person, size: float, begin: Floats, chance: Chance) -> Floats:
    """(12,) the end of a stroke to `posture` in this trial, with habits, amplitude and variation."""
    rest = person.rest_posture
    away = posture.vector(rest) - rest
    moving = np.zeros(MOTION_CHANNELS)
    moving[RIGHT], moving[LEFT] = posture.right is not None, posture.left is not None
    away += moving * person.habits
    away[:6] += moving[:6] * chance.about(REACH_JITTER, 6)
    away[LEFT] *= person.left_share
    return begin + person.amplitude * size * away


def _swing(element: Swing, person: Person, size: float, start: float, tempo: float, chance: Chance) -> TimedSwing:
    cycles = element.cycles + person.more_cycles + float(chance.rng.choice(CYCLES_CHANGED))
    frequency = tempo / element.period
    phase_rad = float(chance.about(PHASE_JITTER_RAD)) + np.pi * (chance.rng.random() < FLIPPED)
    still = np.zeros(MOTION_CHANNELS)
    weight = np.full(MOTION_CHANNELS, person.waving * size * chance.factor(SWING_SIZE))
    weight[LEFT] *= person.left_share
    sine, cosine, double = (weight * by.vector(still) for by in (element.sine, element.cosine, element.double))
    return TimedSwing(start, cycles / frequency, frequency, phase_rad, sine, cosine, double)
