"""Where a movement begins and ends in a stream, as rest shows it, and how often it has been repeated since. Pure.

A segment ends where the person is still, in whatever posture, and goes on if they go on before they have rested.
Trembling in the rest after a movement begins a segment, too, which is no movement: `MovementBefore` keeps the belief
until then.

People also go from one movement into the next without rest. The begin of the next one is then unknown, and the segment
is no longer used: in continuous karate the classifier of segments is right in 18 % of the frames whose movement began
more than 0.7 s after the segment, the trailing windows in 92 %.

A person who goes to and fro turns round twice a period. A turn counts once the person has come back from the turning
point by more than tremor and noise, so that neither speed, pauses nor drift matter. What counts is the axis along which
the person has moved most (docs/design/model.md).
"""

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from common.message_types import LONGEST_STAY, PAUSE_S
from common.posterior import Repeated
from observer.model.periodicity import Oscillation
from observer.model.training_rows import AFTERGLOW_S
from observer.tracks import Floats, Floats32

T = TypeVar("T", bound=np.generic)

STILL_LAG_S = 0.3
"""The delay of stillness: a movement begins this long before stillness ends."""
SHOWN, PAST_S = 0.3, AFTERGLOW_S
"""P(something else) below SHOWN shows a movement; that movement is past when it exceeds 1 - SHOWN for STILL_LAG_S, the
time for which rest shows, too. Who is still after it for PAST_S has ended it."""
SURE = 0.8
"""A movement with a higher probability for STILL_LAG_S is named; a segment with two named ones holds more than one."""


class MovementSegment:
    """Begins when rest ends, and is over while the person is still after it; unknown once the next movement has begun.

    begun: frames from its begin to now or to its end, None while the begin is unknown; over: whether the person is
    still after it; ended: frames since then. number: of segments that began before it. lag: frames by which stillness
    is noticed late. onset_known: the first frame is the begin of one movement; otherwise it is taken for it until the
    person has rested, because a film may begin in a movement. longest: frames of the longest segment.
    """

    def __init__(self, rate_hz: float, onset_known: bool, longest: float) -> None:
        self.begun: int | None = 0
        self.over, self.ended, self.number = False, 0, 0
        self.lag = max(round(STILL_LAG_S * rate_hz), 1)
        self._longest = longest
        self._past_frames = PAST_S * rate_hz
        # Whether the person has moved in the segment, did anything but rest in the stream, and rested after that.
        self._moves, self._moved, self._moved_before = False, False, not onset_known
        self._rested, self._still, self._single = 0, 0, onset_known
        # Whether a movement was shown in the segment, and for how many frames in a row something else after it.
        self._shown, self._otherwise = False, 0
        # The first movement named in the segment, the one that is sure now, and for how many frames in a row.
        self._first: int | None = None
        self._sure, self._sure_frames = -1, 0

    def update(self, resting: bool, still: float, answers: Floats, something_else: float, stored: int) -> None:
        """Take in one more frame: whether the person rests in it, P(still), and the answers of the trailing windows.

        answers: (M + 1,) probabilities, something else last; something_else: its probability by all members. stored:
        the number of frames whose rows are stored.
        """
        self._moved = self._moved or not resting
        self._still = self._still + 1 if still > 0.5 else 0
        if self.begun is not None:
            self._moves = self._moves or still < 0.5
            self.over = (self._moved and resting) or (self._moves and self._still > self._past_frames)
            # A movement that goes on after a pause has lasted through it.
            self.begun += 0 if self.over else 1 + self.ended
            self.ended = self.ended + 1 if self.over else 0
            is_next = self._is_shown_again(resting, something_else) or self._is_another(answers)
            if self.begun > min(self._longest, stored) or (is_next and not self._single):
                self.begun = None
        if self._rested >= self.lag and not self._moved and self._moved_before:
            self.begun = None
        if self._rested >= self.lag and still < 0.5 and self._moved_before:
            self.begun, self.over, self.ended, self.number = min(self.lag, stored), False, 0, self.number + 1
            self._moves = True
            self._shown, self._otherwise, self._first, self._single = False, 0, None, False
        if resting and self._moved:
            self._moved_before = True
        # Somebody who is still has not ended their rest, whatever their posture looks like.
        self._rested = self._rested + resting if still >= 0.5 else 0

    def _is_another(self, answers: Floats) -> bool:
        """Whether another movement is named than at first."""
        likeliest = int(answers[:-1].argmax())
        if answers[likeliest] <= SURE:
            self._sure_frames = 0
            return False
        self._sure_frames = self._sure_frames + 1 if likeliest == self._sure else 1
        self._sure = likeliest
        if self._sure_frames <= self.lag:
            return False
        self._first = likeliest if self._first is None else self._first
        return likeliest != self._first

    def _is_shown_again(self, resting: bool, something_else: float) -> bool:
        """Whether a movement is shown again, after something else that was no rest."""
        is_past = self._otherwise > self.lag
        self._shown = self._shown or something_else < SHOWN
        if not is_past:
            is_other = self._shown and not resting and something_else > 1 - SHOWN
            self._otherwise = self._otherwise + 1 if is_other else 0
        return is_past and something_else < SHOWN

    def rows_of(self, rows: NDArray[T]) -> NDArray[T]:
        """(F, C) rows of the stream until now -> those of the segment; none where no begin is known."""
        end = max(len(rows) - self.ended, 0)
        return rows[max(end - (self.begun or 0), 0) : end]


class MovementBefore:
    """What was believed when a segment began; it stands in rest as far as the segment is no movement.

    With e the least P(something else) of the segment's instants and r = P(rest now), either the segment is a movement,
    1 - e, or nothing has begun and the person still rests, e r:

        p = ((1 - e) p_segment + e r p_before) / (1 - e + e r)
    """

    def __init__(self) -> None:
        self._p: Floats | None = None
        self._nothing = 1.0

    def begin(self, p: Floats) -> None:
        """A segment begins; p: (M,) the belief until then."""
        self._p, self._nothing = p, 1.0

    def mixed(self, p: Floats, something_else: float, rest: float) -> Floats:
        """(M,) from what the segment shows: p (M,) of the movements, P(something else), and P(rest)."""
        if self._p is None:
            return p
        self._nothing = min(self._nothing, something_else)
        nothing = self._nothing * rest
        share = nothing / (1 - self._nothing + nothing) if nothing else 0.0
        return (1 - share) * p + share * self._p


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
