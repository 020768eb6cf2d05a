"""One observer's computation, from a frame to a posterior. No network and no clock."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from common import SECOND_NS
from common.vocabulary import Vocabulary
from observer.effort.reader import FacetReader
from observer.model.base import MovementModel, Onset
from observer.model.posterior_calibration import calibrated_posterior
from observer.tracks import Floats, Frame, Tracker, Tracks

TINY = 1e-300
"""Divisor for movements that have no probability."""
LONGEST_BRIDGE_S = 0.25
"""Over gaps up to this length a body part is taken to move in a straight line; over longer ones it is not seen."""
LONGEST_GAP_S = 3.0
"""A longer gap counts as this long: by then the filter has forgotten all that it can forget."""


@dataclass(frozen=True, slots=True)
class Posterior:
    """An observer's state after a frame.

    p: (M,) posterior over the vocabulary, cumulative since the movement began. rest: probability that the person is at
    rest. frames: number of frames so far, at the model's rate. visible: per body part, whether it is seen in the newest
    frame. facets: distributions over the values of facets (common.facets), where available. facing: (M, K)
    P(facing | movement), None for a model with one facing. unlearned: probability that the movement is none of the
    vocabulary, None if the model cannot tell.
    """

    p: Floats
    rest: float
    frames: int
    visible: Mapping[str, bool]
    facets: Mapping[str, Floats] = field(default_factory=dict)
    facing: Floats | None = None
    unlearned: float | None = None


class Resampler:
    """Resamples tracks from any frame times to a model's fixed rate, by linear interpolation.

    The model therefore sees the same motion from a faster camera, a slower one, or one that drops frames. There is no
    delay: each instant is returned with the first frame at or after it.
    """

    def __init__(self, rate_hz: float) -> None:
        """rate_hz: the model's rate, > 0."""
        self._period_ns = SECOND_NS / rate_hz
        self._begin_ns = 0
        self._count = 0
        self._previous: tuple[int, Floats] | None = None

    def update(self, at_ns: int, tracks: Tracks) -> list[Tracks]:
        """The instants after the previous frame, up to this frame at `at_ns`: any number of tracks (P, 2).

        A part that is seen in only one of the two frames around an instant counts as seen where that frame is the
        nearer one. If the clock is set back, sampling restarts.
        """
        previous, self._previous = self._previous, (at_ns, tracks.centres)
        if previous is None or at_ns < previous[0]:
            self._begin_ns, self._count = at_ns, 1
            return [tracks]
        if at_ns == previous[0]:
            return []
        count = int((at_ns - self._begin_ns) / self._period_ns) + 1
        count += self._instant_ns(count) <= at_ns  # rounding must not hold an instant back
        first = max(self._count, count - round(LONGEST_GAP_S * SECOND_NS / self._period_ns))
        self._count = max(count, self._count)
        newest = (at_ns, tracks.centres)
        return [Tracks(_interpolate(previous, newest, self._instant_ns(i))) for i in range(first, count)]

    def _instant_ns(self, i: int) -> int:
        return self._begin_ns + round(i * self._period_ns)


def _interpolate(previous: tuple[int, Floats], newest: tuple[int, Floats], instant_ns: int) -> Floats:
    share = (instant_ns - previous[0]) / (newest[0] - previous[0])
    if newest[0] - previous[0] > LONGEST_BRIDGE_S * SECOND_NS:
        return newest[1] if share >= 1 else np.full_like(newest[1], np.nan)
    nearer = newest[1] if share > 0.5 else previous[1]
    mixed = (1 - share) * previous[1] + share * newest[1]
    centres: Floats = np.where(np.isfinite(mixed), mixed, nearer)
    return centres


class Observer:
    """Steps 3 to 6 of docs/design/frame.md: tracks the body parts, reads features and updates the filter.

    resampler: brings frames to the model's rate; None if they arrive at it. facets: reads Effort and Shape at that
    rate.
    """

    def __init__(
        self,
        tracker: Tracker,
        model: MovementModel,
        onset: Onset | None = None,
        resampler: Resampler | None = None,
        facets: FacetReader | None = None,
    ) -> None:
        self._tracker, self._resampler, self._facets = tracker, resampler, facets
        self._watch = model.watch(onset or Onset())
        self._calibration = model.header.calibration
        self.vocabulary: Vocabulary = model.header.vocabulary
        self._frames = 0
        self.tracks: Tracks | None = None

    @property
    def complaint(self) -> str:
        """Why the tracker finds little in the pictures, and what to do about it; "" if all is well."""
        return str(getattr(self._tracker, "complaint", ""))

    def step(self, frame: Frame) -> Posterior:
        """The posterior after one more frame; it does not change while no instant of the model is due.

        The frame's tracks are left in `tracks`.
        """
        self.tracks = self._tracker.update(frame)
        instants = [self.tracks] if self._resampler is None else self._resampler.update(frame.at_ns, self.tracks)
        for tracks in instants:
            self._watch.update(tracks)
            if self._facets is not None:
                self._facets.update(tracks, self._watch.rest)
        self._frames += len(instants)
        visible = dict(zip(self._tracker.body_parts, self.tracks.visible.tolist(), strict=True))
        facets = {} if self._facets is None else self._facets.facets
        joint, unlearned = calibrated_posterior(self._watch, self._calibration)
        p: Floats = joint.sum(axis=1)
        facing = None if joint.shape[1] == 1 else joint / np.maximum(p, TINY)[:, None]
        return Posterior(p, self._watch.rest, self._frames, visible, facets, facing, unlearned)
