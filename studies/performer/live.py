"""A synthetic performer that acts on request, in real time, and stands still in between. Pure.

Times are seconds of any clock that does not run backwards.
"""

import numpy as np

from observer.tracks import Floats
from studies.performer.body import assume
from studies.performer.perform import MotionPlan, compose, idle, standing
from studies.performer.repertoire import KNOWN_PEOPLE, ORDINARY, Score

REACTION_S = (0.2, 0.5)
"""A person begins this long after the signal; simple reactions to a light take from 0.2 s on."""
LIVE_BETWEEN_S = (0.5, 2.0)
"""Rest between two pieces of ordinary life: long enough to stand, short enough to be busy most of the time."""


class LivePerformer:
    """One of the synthetic people; the same seed and the same requests give the same motion."""

    def __init__(self, person: str, seed: int) -> None:
        self._person, self._seed = KNOWN_PEOPLE[person], seed
        self._rng = np.random.default_rng(seed)
        self._posture = standing(self._person, self._rng)
        self._plan: MotionPlan | None = None
        self._begin_s = self._end_s = self._due_s = float("-inf")
        self._asked: Score | None = None
        self._lives = False
        self._left: list[Score] = []

    def act(self, score: Score, now_s: float) -> None:
        """Perform once, after a movement that goes on; ordinary life ends."""
        self._asked, self._lives = score, False
        self._due_s = now_s + float(self._rng.uniform(*REACTION_S))

    def live(self, now_s: float) -> None:
        """Ordinary life from now on: step aside, scratch the head and so on, each once before one comes again."""
        self._asked, self._lives, self._due_s = None, True, now_s

    def rest(self) -> None:
        """Stand, after a movement that goes on or was asked for."""
        self._lives = False

    def positions(self, now_s: float) -> Floats:
        """(3, 3) left hand, right hand, head in metres, on the axes of the archive."""
        if now_s >= max(self._due_s, self._end_s) and (score := self._next_score()) is not None:
            self._start(score, now_s)
        # The same seed each time: sway is one motion, of which this is an instant.
        posture = self._posture + idle(np.array([now_s]), self._person, np.random.default_rng(self._seed))
        if self._plan is not None:
            posture = posture + self._plan.displacement(np.array([now_s - self._begin_s]))
        positions: Floats = assume(self._person.build, posture).positions[0]
        return positions

    def _next_score(self) -> Score | None:
        asked, self._asked = self._asked, None
        if asked is not None or not self._lives:
            return asked
        self._left = self._left or [ORDINARY[n] for n in self._rng.permutation(len(ORDINARY))]
        return self._left.pop()

    def _start(self, score: Score, now_s: float) -> None:
        if self._plan is not None:
            self._posture = self._plan.end
        self._plan, self._begin_s = compose(score, self._person, self._posture, self._rng), now_s
        self._end_s = now_s + self._plan.duration
        self._due_s = self._end_s + float(self._rng.uniform(*LIVE_BETWEEN_S))
