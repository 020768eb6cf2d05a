"""One observer, from a frame to its opinion. No network and no clock inside."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from common.vocabulary import Vocabulary
from observer.effort.reader import FacetReader
from observer.model.base import MovementModel, Onset
from observer.model.posterior_calibration import believed
from observer.tracks import Floats, Frame, Tracker, Tracks

SMALLEST = 1e-300
"""Stands for 0 where it divides."""


@dataclass(frozen=True, slots=True)
class Posterior:
    """What an observer believes after a frame.

    p: (M,) posterior over the vocabulary. rest: probability that the person is at rest. frames: how many are in it.
    visible: per body part, whether it was seen in the newest frame. facets: of common.facets, those that can be said.
    facing: (M, K) P(facing | movement), None of a model that knows one alone. unlearned: probability that what is done
    is none of the vocabulary's movements, None where that cannot be told.
    """

    p: Floats
    rest: float
    frames: int
    visible: Mapping[str, bool]
    facets: Mapping[str, Floats] = field(default_factory=dict)
    facing: Floats | None = None
    unlearned: float | None = None


SECOND_NS = 1_000_000_000
BRIDGE_S = 0.25
"""Between two frames no further apart than this a part moved in a straight line; over longer gaps nothing is known."""
BLIND_S = 3.0
"""A longer gap counts as this long: all that can be forgotten about a movement is forgotten by then."""


class Resampler:
    """Tracks at any times in, tracks at a model's rate out, by linear interpolation between neighbouring frames.

    A camera faster than the model, slower, or with frames left out: the belief sees the same motion. Nothing is
    delayed: an instant is handed out with the first frame at or after it.
    """

    def __init__(self, rate_hz: float) -> None:
        """rate_hz: the model's, > 0."""
        self._period_ns = SECOND_NS / rate_hz
        self._begin_ns = 0
        self._count = 0
        self._before: tuple[int, Floats] | None = None

    def update(self, at_ns: int, tracks: Tracks) -> list[Tracks]:
        """The instants after the frame before, up to this frame at `at_ns`: none, one or several (P, 2) each.

        A part that only one of the two frames around an instant shows is seen where that frame is the nearer one.
        A clock that was set back begins anew.
        """
        before, self._before = self._before, (at_ns, tracks.centres)
        if before is None or at_ns <= before[0]:
            if before is None or at_ns < before[0]:
                self._begin_ns, self._count = at_ns, 1
                return [tracks]
            return []
        count = int((at_ns - self._begin_ns) / self._period_ns) + 1
        count += self._instant(count) <= at_ns  # rounding must not hold an instant back
        first = max(self._count, count - round(BLIND_S * SECOND_NS / self._period_ns))
        self._count = max(count, self._count)
        return [Tracks(_between(before, (at_ns, tracks.centres), self._instant(i))) for i in range(first, count)]

    def _instant(self, i: int) -> int:
        return self._begin_ns + round(i * self._period_ns)


def _between(before: tuple[int, Floats], now: tuple[int, Floats], instant_ns: int) -> Floats:
    share = (instant_ns - before[0]) / (now[0] - before[0])
    if now[0] - before[0] > BRIDGE_S * SECOND_NS:
        return now[1] if share >= 1 else np.full_like(now[1], np.nan)
    nearer = now[1] if share > 0.5 else before[1]
    mixed = (1 - share) * before[1] + share * now[1]
    straight: Floats = np.where(np.isfinite(mixed), mixed, nearer)
    return straight


class Observer:
    """Tracks, reads and believes: `step` is steps 3 to 6 of a frame's way (docs/design/frame.md).

    pace: brings the frames to the model's rate; None: they come at it. facets: reads Effort and Shape at that rate.
    """

    def __init__(
        self,
        tracker: Tracker,
        model: MovementModel,
        onset: Onset | None = None,
        pace: Resampler | None = None,
        facets: FacetReader | None = None,
    ) -> None:
        self._tracker, self._pace, self._facets = tracker, pace, facets
        self._watch = model.watch(onset or Onset())
        self._certainty = model.header.certainty
        self.vocabulary: Vocabulary = model.header.vocabulary
        self._frames = 0
        self.tracks: Tracks | None = None

    @property
    def complaint(self) -> str:
        """Why the tracker makes out little in the pictures, and what to do; "" when all is well."""
        return str(getattr(self._tracker, "complaint", ""))

    def step(self, frame: Frame) -> Posterior:
        """One frame, as it comes; while no instant of the model is due the belief stays. Leaves `tracks`."""
        self.tracks = self._tracker.update(frame)
        instants = [self.tracks] if self._pace is None else self._pace.update(frame.at_ns, self.tracks)
        for tracks in instants:
            self._watch.update(tracks)
            if self._facets is not None:
                self._facets.update(tracks, self._watch.rest)
        self._frames += len(instants)
        visible = dict(zip(self._tracker.body_parts, self.tracks.visible.tolist(), strict=True))
        facets = {} if self._facets is None else self._facets.facets
        learned, unlearned = believed(self._watch, self._certainty)
        p: Floats = learned.sum(axis=1)
        facing = None if learned.shape[1] == 1 else learned / np.maximum(p, SMALLEST)[:, None]
        return Posterior(p, self._watch.rest, self._frames, visible, facets, facing, unlearned)
