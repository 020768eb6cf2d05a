"""How `stacked` watches one person: both members, and the nearest of few takes (docs/design/model.md)."""

import math
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from observer.model.base import Onset, Watch
from observer.model.discriminative import DiscriminativeWatch
from observer.model.few_takes import pooled_with_takes, something_else_with_takes
from observer.model.log_linear_pool import SMALLEST
from observer.model.nearest_take import WEIGHT, NearestTakeWatch
from observer.model.phase import PhaseWatch, posture_reader
from observer.model.something_else import add_log_odds, disagreement
from observer.model.stack_exponents import ENDED, RUNNING
from observer.tracks import Floats, Tracks

if TYPE_CHECKING:
    from observer.model.stacked import Stacked

TURN_S = 5.0
"""In this time the facing that was last known is forgotten, if nothing shows it."""


class StackedWatch(Watch):
    """Watches one person. The phase filter starts anew at each begin of a segment, with the frames since then."""

    def __init__(self, model: "Stacked", onset: Onset) -> None:
        self._model = model
        self._discriminative: DiscriminativeWatch = model.discriminative.watch(onset)
        self._phase: PhaseWatch | None = None
        self._nearest: NearestTakeWatch | None = None
        self._reader = posture_reader(model.phase.header)
        # Features and stillness of the last frames.
        self._recent: deque[tuple[Floats, float]] = deque(maxlen=self._discriminative.segment.lag + 1)
        facings = model.phase.facings
        self._facing: Floats = np.full(facings, 1.0 / facings)
        self._turned = 1 - math.exp(-1 / (TURN_S * model.header.rate_hz))

    def update(self, tracks: Tracks) -> None:
        """Take in one frame."""
        self._follow(tracks, self._discriminative.update)

    def pass_over(self, tracks: Tracks) -> None:
        """Take in one frame, without classifying what has been seen."""
        self._follow(tracks, self._discriminative.pass_over)

    def _follow(self, tracks: Tracks, take_in: Callable[[Tracks], None]) -> None:
        before = self._discriminative.segment.begun
        take_in(tracks)
        begun, frame = self._discriminative.segment.begun, self._discriminative.trace.frame
        self._recent.append((self._reader.read(tracks, frame.origin, frame.size), frame.still))
        if not tracks.visible.any():
            return
        if begun is None:
            self._phase = self._nearest = None
        elif self._phase is None or (before is None or begun < before):
            self._phase = self._model.phase.watch(Onset(known=True))
            for features, still in list(self._recent)[-begun:]:
                self._phase.step(features, still)
            if self._model.takes is not None:
                rows = self._discriminative.rows
                self._nearest = NearestTakeWatch(self._model.takes, rows[len(rows) - begun :])
        elif not self._discriminative.segment.over:
            self._phase.step(*self._recent[-1])
            if self._nearest is not None:
                self._nearest.step(self._discriminative.rows[-1])
        self._follow_facing()

    def _follow_facing(self) -> None:
        """P(facing): that of the phase filter; while it does not run, people turn."""
        if len(self._facing) == 1:
            return
        joint = None if self._phase is None else self._phase.joint
        facing = np.full_like(self._facing, 1.0 / len(self._facing)) if joint is None else joint.sum(axis=0)
        self._facing += (facing - self._facing) * (self._turned if joint is None else 1.0)

    def end(self) -> None:
        """The recording has ended, and with it the movement."""
        self._discriminative.end()

    @property
    def _judges_by_takes(self) -> bool:
        """Whether the posterior is that of few_takes.py: few takes by several people, and the begin is known."""
        return self._nearest is not None and self._model.judges_by_takes

    @property
    def _take_distances(self) -> Floats:
        """(M,) relative distance from the nearest take of each movement; inf while unknown."""
        return np.empty(0) if self._nearest is None else self._nearest.relative_distances

    @property
    def _log_joint(self) -> Floats:
        """(M, K) not normalised; K = 1 without facings."""
        movements = np.log(np.maximum(self._discriminative.p, SMALLEST))
        if self._phase is None:
            # The exponents were learned for both members together; one that judges alone is believed as it is.
            return movements[:, None] + np.log(np.maximum(self._facing, 1e-300))
        if self._judges_by_takes:
            return np.log(pooled_with_takes(self._phase.p, self._discriminative.p, self._take_distances))[:, None]
        names = ENDED if self._discriminative.judges_ended else RUNNING
        generative, discriminative = (self._model.header.parameters[name] for name in names)
        movements *= discriminative
        joint, phase = self._phase.joint, self._phase.p
        movements += generative * np.log(np.maximum(phase, SMALLEST))
        if joint is None:
            return movements[:, None]
        facing = joint / np.maximum(phase, 1e-300)[:, None]
        return movements[:, None] + np.log(np.maximum(facing, 1e-300))

    @property
    def _posterior(self) -> Floats:
        logs = self._log_joint
        p = np.exp(logs - logs.max())
        doubt = self._discriminative.doubt
        posterior: Floats = (1 - doubt) * p / p.sum() + doubt / p.size
        return posterior

    @property
    def p(self) -> Floats:
        """(M,) posterior given that it is one of the movements."""
        p: Floats = self._posterior.sum(axis=1)
        return p

    @property
    def joint(self) -> Floats | None:
        """(M, K) posterior over movements and facings; None for a model of one facing."""
        return self._posterior if self._model.phase.facings > 1 else None

    @property
    def unlearned(self) -> Floats | None:
        """(K,) P(something else, facing)."""
        p, nats = float(self._discriminative.unlearned[0]), 0.0
        if self._phase is not None and self._judges_by_takes:
            # A person out of sight is forgotten by both.
            offset = self._model.else_offset
            p_else = something_else_with_takes(self._phase.p, self._discriminative.p, self._take_distances, p, offset)
            return (p_else + (p - p_else) * self._discriminative.doubt) * self._facing
        if self._phase is not None and not self._discriminative.judges_ended:
            members = np.array([self._phase.p, self._discriminative.p])
            nats = disagreement(members, self._model.confusions, self._model.header.parameters)
        if self._nearest is not None:
            nats += self._nearest.nats(int(self.p.argmax()), self._model.header.parameters[WEIGHT])
        return add_log_odds(p, nats * (1 - self._discriminative.doubt)) * self._facing

    @property
    def rest(self) -> float:
        """P(at rest now)."""
        return self._discriminative.rest
