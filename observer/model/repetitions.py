"""Counts how often a periodic movement has been repeated since it began, as a stream of traces shows it. Pure.

A person who goes to and fro turns round twice a period. A turn counts once the person has come back from the turning
point by more than tremor and noise, so that neither speed, pauses nor drift matter (docs/design/model.md).
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from common.message_types import LONGEST_STAY, PAUSE_S
from observer.model.periodicity import Oscillation
from observer.tracks import Floats, Floats32

LEAST_RETURN = 0.3
"""Of the swing: who comes back by less has not turned round. On ui_prmd .2 to .3 do best, also for repetitions that are
half as large; .4 loses six sets of 98."""


class RepetitionCounter:
    """Counts the repetitions of all periodic movements at once. It begins anew with the first turn after a long rest.

    oscillations: by the movement's index in the vocabulary, at least one.
    """

    def __init__(self, oscillations: Mapping[int, Oscillation], rate_hz: float) -> None:
        self._place = {movement: n for n, movement in enumerate(oscillations)}
        own = oscillations.values()
        self._axes: Floats = np.stack([_of_rows(oscillation.axes) for oscillation in own])
        self._least = LEAST_RETURN * np.array([[oscillation.swing] for oscillation in own])
        self._longest = LONGEST_STAY * rate_hz * np.array([oscillation.period_s for oscillation in own])
        pauses_s = [PAUSE_S if oscillation.rest_s is None else oscillation.rest_s for oscillation in own]
        self._pauses = np.round(rate_hz * np.array(pauses_s))
        # At first it is not known whether the person goes to or fro: the first of two axes expects the one, the second
        # the other. From the first turn on they are the same.
        shape = (2, *self._axes.shape[:2])
        self._sense = np.ones(shape)
        self._sense[1] = -1.0
        self._farthest, self._turns = np.full(shape, -np.inf), np.zeros(shape)
        self._stayed, self._over, self._rested = np.zeros(shape[1]), np.zeros(shape[1], np.bool_), 0

    def update(self, row: Floats32, resting: bool) -> None:
        """Take in one frame: (2 P + 3,) row of the trace, and whether the person rests."""
        self._rested = self._rested + 1 if resting else 0
        if resting:
            self._over |= self._pauses == self._rested
        self._stayed += 1
        place = self._sense * (self._axes @ row)
        np.maximum(self._farthest, place, out=self._farthest)
        turned = self._farthest - place >= self._least
        if turned.any():
            self._turn(turned, place)

    def _turn(self, turned: NDArray[np.bool_], place: Floats) -> None:
        movements = turned.any(axis=(0, 2))
        self._turns[:, movements & (self._over | (self._stayed > self._longest))] = 0
        self._over[movements] = False
        self._stayed[movements] = 0
        self._turns += turned
        self._sense[turned] *= -1
        self._farthest[turned] = -place[turned]

    def count(self, movement: int) -> float | None:
        """Periods of the movement since it began; None if it is not periodic."""
        place = self._place.get(movement)
        return None if place is None else float(self._turns[:, place].max()) / 2


def _of_rows(axes: Floats) -> Floats:
    """(A, 2 P) axes of postures -> (A, 2 P + 3) the same of rows of a trace."""
    up = axes[:, 1::2].sum(axis=1, keepdims=True)
    none = np.zeros_like(up)
    result: Floats = np.concatenate([axes, none, up, none], axis=1)
    return result
