"""From a score to one trial of a person: habits and random variation applied, and the postures over time."""

from dataclasses import dataclass

import numpy as np

from observer.tracks import Floats
from studies.performer.body import CHANNELS, LEFT, RIGHT, Posture
from studies.performer.repertoire import Hold, Person, Score, Stroke, Swing

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
        return sum((part.displacement(time) for part in self.parts), np.zeros((len(time), CHANNELS)))


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
    moving = np.zeros(CHANNELS)
    moving[RIGHT], moving[LEFT] = posture.right is not None, posture.left is not None
    away += moving * person.habits
    away[:6] += moving[:6] * chance.about(REACH_JITTER, 6)
    away[LEFT] *= person.left_share
    return begin + person.amplitude * size * away


def _swing(element: Swing, person: Person, size: float, start: float, tempo: float, chance: Chance) -> TimedSwing:
    cycles = element.cycles + person.more_cycles + float(chance.rng.choice(CYCLES_CHANGED))
    frequency = tempo / element.period
    phase_rad = float(chance.about(PHASE_JITTER_RAD)) + np.pi * (chance.rng.random() < FLIPPED)
    still = np.zeros(CHANNELS)
    weight = np.full(CHANNELS, person.waving * size * chance.factor(SWING_SIZE))
    weight[LEFT] *= person.left_share
    sine, cosine, double = (weight * by.vector(still) for by in (element.sine, element.cosine, element.double))
    return TimedSwing(start, cycles / frequency, frequency, phase_rad, sine, cosine, double)
