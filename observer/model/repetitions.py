"""Counts how often a periodic movement has been repeated since it began, as a stream of traces shows it. Pure.

A person who goes to and fro turns round twice a period. A turn counts once the person has come back from the turning
point by more than tremor and noise, so that neither speed, pauses nor drift matter. What counts is the axis along which
the person has moved most (docs/design/model.md).
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from common.message_types import LONGEST_STAY, PAUSE_S
from common.posterior import Repeated
from observer.model.periodicity import Oscillation
from observer.tracks import Floats, Floats32

LEAST_RETURN = 0.3
"""Of the swing: who comes back by less has not turned round. On ui_prmd .2 to .3 do best, also for repetitions that are
half as large; .4 loses six sets of 98."""
PARTIAL = 0.65
"""Of the usual swing: a smaller one is partial. Of the correct repetitions of people left out of ui_prmd .5 % are
smaller, of those that are deliberately incorrect 26 %."""


class RepetitionCounter:
    """Counts the repetitions of all periodic movements at once. It begins anew with the first turn after a long rest.

    oscillations: by the movement's index in the vocabulary, at least one.
    """

    def __init__(self, oscillations: Mapping[int, Oscillation], rate_hz: float) -> None:
        self._place = {movement: n for n, movement in enumerate(oscillations)}
        own = oscillations.values()
        self._axes: Floats = np.stack([_of_rows(oscillation.axes) for oscillation in own])
        self._usual: Floats = np.stack([oscillation.swings for oscillation in own])
        self._swing = np.array([[oscillation.swing] for oscillation in own])
        self._least = LEAST_RETURN * self._swing
        self._longest = LONGEST_STAY * rate_hz * np.array([oscillation.period_s for oscillation in own])
        pauses_s = [PAUSE_S if oscillation.rest_s is None else oscillation.rest_s for oscillation in own]
        self._pauses = np.round(rate_hz * np.array(pauses_s))
        # Everyone begins at home, or is at the far side already: the first turn that is looked for is there.
        shape = self._axes.shape[:2]
        self._sense, self._farthest = np.ones(shape), np.full(shape, -np.inf)
        self._far, self._partial, self._energy = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        # Where the person turned last, or began.
        self._from: Floats | None = None
        self._stayed, self._over, self._rested = np.zeros(shape[0]), np.zeros(shape[0], np.bool_), 0
        self._ended = False

    def update(self, row: Floats32, resting: bool) -> None:
        """Take in one frame: (2 P + 3,) row of the trace, and whether the person rests."""
        self._rested = self._rested + 1 if resting else 0
        if resting:
            self._over |= self._pauses == self._rested
        self._stayed += 1
        along = self._axes @ row
        if self._from is None:
            self._from = along
        place = self._sense * along
        np.maximum(self._farthest, place, out=self._farthest)
        turned = self._farthest - place >= self._least
        if turned.any():
            self._turn(turned, place, self._from)

    def end(self) -> None:
        """There are no more frames."""
        self._ended = True

    def _turn(self, turned: NDArray[np.bool_], place: Floats, since: Floats) -> None:
        """since: where the person turned before, or began."""
        movements = turned.any(axis=1)
        anew = movements & (self._over | (self._stayed > self._longest))
        for sums in (self._far, self._partial, self._energy):
            sums[anew] = 0
        self._over[movements] = False
        self._stayed[movements] = 0
        reached, is_far = self._sense * self._farthest, self._sense > 0
        swings = np.abs(reached - since)
        self._far += turned & is_far
        # The way to where it begins, and back, is one swing as others are, however far it is.
        self._energy += turned * np.minimum(swings, self._swing) ** 2
        self._partial += turned & is_far & (swings < PARTIAL * self._usual)
        since[turned] = reached[turned]
        self._sense[turned] *= -1
        self._farthest[turned] = -place[turned]

    def _counted(self, place: int) -> tuple[float, float]:
        """Periods of a movement, and how many went less far, along the axis on which the person moved most."""
        n = int(self._energy[place].argmax())
        return float(self._far[place, n]) + self._begun(place, n), float(self._partial[place, n])

    def _begun(self, place: int, n: int) -> float:
        """Of the next repetition: 1/2 once the person has left home for it, and not come back.

        Who rests as far as it usually goes, or is not seen any more from there on, has done it: 1.
        """
        if self._from is None or self._sense[place, n] < 0:
            return 0.0
        reach = self._farthest[place, n] - self._from[place, n]
        if reach < self._least[place, 0]:
            return 0.0
        is_over = self._ended or self._rested > 0
        return 1.0 if is_over and reach >= PARTIAL * self._usual[place, n] else 0.5

    def count(self, movement: int) -> float | None:
        """Periods of the movement since it began; None if it is not periodic."""
        place = self._place.get(movement)
        return None if place is None else self._counted(place)[0]

    def repeated(self, movement: int) -> Repeated | None:
        """How many periods were partial, and the usual swing, body sizes; None if it is not periodic."""
        place = self._place.get(movement)
        return None if place is None else Repeated(partial=self._counted(place)[1], swing=float(self._swing[place, 0]))


def _of_rows(axes: Floats) -> Floats:
    """(A, 2 P) axes of postures -> (A, 2 P + 3) the same of rows of a trace."""
    up = axes[:, 1::2].sum(axis=1, keepdims=True)
    none = np.zeros_like(up)
    return np.concatenate([axes, none, up, none], axis=1)
