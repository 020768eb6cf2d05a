"""The four synthetic people: invented sizes and habits, as unlike as four people in a room may be."""

from dataclasses import dataclass

import numpy as np

from observer.tracks import Floats
from studies.performer.body import Build, Reach, rest_vector


@dataclass(frozen=True, slots=True)
class Person:
    """One person's size and habits; 1.0 is the middle wherever nothing else is said.

    height: metres. tempo: how fast. amplitude: how far a posture is from rest. waving: how wide swings are.
    sharpness: 1 or more; strokes take 1/sharpness of their time and then stand. attack: above 1 strokes are late
    to gather speed, below 1 early. curl: share of a stroke by which the hand's height goes ahead of its other two
    directions (negative: behind), which bends its path. rest, habit: reach of both hands at rest, and what is added
    to every other reach. left_share: how much the left arm joins in. sway: idle sway. more_cycles: added to swings.
    """

    height: float
    tempo: float
    amplitude: float
    waving: float
    sharpness: float
    attack: float
    curl: float
    rest: Reach
    habit: Reach
    left_share: float
    sway: float
    more_cycles: float

    @property
    def build(self) -> Build:
        """The lengths of this person's segments."""
        return Build(self.height)

    @property
    def rest_posture(self) -> Floats:
        """(12,) how this person stands."""
        return rest_vector(self.rest)

    @property
    def habits(self) -> Floats:
        """(12,) what this person adds to the reach of a hand that is not at rest."""
        return np.array([*self.habit, *self.habit, *np.zeros(6)])


KNOWN_PEOPLE = {
    "1": Person(
        height=1.72,
        tempo=1.0,
        amplitude=1.0,
        waving=1.0,
        sharpness=1.1,
        attack=1.0,
        curl=0.1,
        rest=(0.16, -0.92, 0.06),
        habit=(0.0, 0.0, 0.0),
        left_share=1.0,
        sway=1.0,
        more_cycles=0.0,
    ),
    "2": Person(  # small, quick and crisp; keeps the elbows in
        height=1.56,
        tempo=1.2,
        amplitude=0.9,
        waving=0.8,
        sharpness=1.25,
        attack=0.9,
        curl=0.3,
        rest=(0.08, -0.88, 0.16),
        habit=(-0.06, 0.04, -0.03),
        left_share=0.75,
        sway=0.7,
        more_cycles=0.5,
    ),
    "3": Person(  # tall, slow and wide
        height=1.94,
        tempo=0.83,
        amplitude=1.07,
        waving=1.25,
        sharpness=1.0,
        attack=1.15,
        curl=-0.2,
        rest=(0.22, -0.93, 0.0),
        habit=(0.08, 0.03, 0.02),
        left_share=1.1,
        sway=1.4,
        more_cycles=-0.5,
    ),
    "4": Person(  # easy-going: low hands, narrow swings, hardly the left arm
        height=1.81,
        tempo=1.07,
        amplitude=0.93,
        waving=0.9,
        sharpness=1.1,
        attack=1.05,
        curl=0.0,
        rest=(0.14, -0.9, 0.1),
        habit=(0.04, -0.07, 0.05),
        left_share=0.6,
        sway=1.1,
        more_cycles=0.0,
    ),
}
"""The people by the names that archives know them by."""
