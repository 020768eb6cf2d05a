"""Looks at a picture only when there can be something new in it (pacing.py, motion_gate.py)."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.vocabulary import Vocabulary
from observer.camera.base import Picture
from observer.runtime.motion_gate import COLUMNS, ROWS, Cells, MotionGate
from observer.runtime.pacing import TrackingPace
from observer.runtime.pipeline import Observer, Posterior
from observer.tracks import Floats, Frame, Tracker, Tracks

GATE_HZ, EMPTY_GATE_HZ = 30.0, 15.0
"""Pictures that come faster are not all compared; in an empty room, where nobody can begin a movement, even fewer."""
SAMPLED_PX = 240
"""Of a picture about so many rows or columns are read, whichever are fewer."""
RESTING_RUNS = 4
"""While nothing changes, tracks are the mean of so many runs: the parts stay, only the tracker trembles."""
HEARTBEAT, EMPTY_HEARTBEAT = 0.45, 0.2
"""Posteriors are repeated after this share of fresh_s, so that they stay fresh, and when nobody is there, after this
share of drop_s: an observer that sees nobody has no opinion to keep fresh, and must only not seem dead."""


@dataclass(frozen=True, slots=True)
class Heartbeats:
    """Seconds after which a posterior is repeated: of a person at rest, and of an empty room."""

    rest_s: float
    empty_s: float

    @classmethod
    def of(cls, fusion: FusionConfig) -> "Heartbeats":
        """Those that suit the fusion service."""
        return cls(HEARTBEAT * fusion.fresh_s, EMPTY_HEARTBEAT * fusion.drop_s)


class PacedObserver:
    """An `ObserverLike` without a posterior for pictures that its tracker skips."""

    def __init__(self, observer: Observer, tracker: "PacedTracker") -> None:
        self._observer, self._tracker = observer, tracker
        self.vocabulary: Vocabulary = observer.vocabulary

    @property
    def complaint(self) -> str:
        """The complaint of the observer."""
        return self._observer.complaint

    def step(self, frame: Frame) -> Posterior | None:
        """The posterior after one more frame; None if it was skipped."""
        tracks = self._tracker.update(frame)
        return None if tracks is None else self._observer.follow(frame, tracks)

    def end(self) -> Posterior | None:
        """The posterior now that the source has ended."""
        return self._observer.end()


class PacedTracker:
    """A tracker that skips pictures. Its tracks of a skipped picture are None, or the last ones as a heartbeat.

    heartbeats: while nobody moves and the pictures do not change, the last tracks are returned so often; they are as
    true of the newest picture as of the one that they were found in. cpu_s: a clock of CPU seconds.
    """

    def __init__(
        self,
        tracker: Tracker,
        pace: TrackingPace,
        heartbeats: Heartbeats,
        cpu_s: Callable[[], float] = time.process_time,
    ) -> None:
        self._tracker, self._pace, self._gate, self._cpu_s = tracker, pace, MotionGate(), cpu_s
        self._heartbeats = heartbeats
        self._last: Tracks | None = None
        self._resting: deque[Floats] = deque(maxlen=RESTING_RUNS)
        self._compared_ns = self._returned_ns = 0

    def update(self, frame: Frame) -> Tracks | None:
        """The tracks in this picture, or None. The last picture of a recording is never skipped."""
        at_ns = frame.captured_ns
        if self._pace.due(at_ns, self._changed(frame)) or frame.last:
            begun_s = self._cpu_s()
            found = self._tracker.update(frame)
            self._pace.ran(at_ns, found, self._cpu_s() - begun_s)
            self._last = self._steadied(found, at_ns)
        elif not self._pace.quiet(at_ns) or not self._heartbeat_due(at_ns):
            return None
        self._returned_ns = at_ns
        return self._last

    def _changed(self, frame: Frame) -> bool:
        """Whether something begins to move; not asked of pictures that come faster than GATE_HZ."""
        if not self._pace.confirmed_quiet:
            self._gate.forget()
            return False
        rate_hz = EMPTY_GATE_HZ if self._pace.empty else GATE_HZ
        if 0 <= frame.captured_ns - self._compared_ns < 0.7 * SECOND_NS / rate_hz:
            return False
        self._compared_ns = frame.captured_ns
        return self._gate.update(cells_of(frame.content), frame.captured_ns)

    def _heartbeat_due(self, at_ns: int) -> bool:
        heartbeat_s = self._heartbeats.empty_s if self._pace.empty else self._heartbeats.rest_s
        return not 0 <= at_ns - self._returned_ns < heartbeat_s * SECOND_NS

    def _steadied(self, found: Tracks, at_ns: int) -> Tracks:
        if not self._pace.quiet(at_ns) or not found.visible.any():
            self._resting.clear()
            return found
        self._resting.append(found.centres)
        runs = np.array(self._resting)
        seen = np.isfinite(runs)
        means = np.where(seen, runs, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
        return Tracks(np.where(np.isfinite(found.centres), means, np.nan), found.guesses)


def cells_of(picture: Picture) -> Cells:
    """(H, W, 3) -> (ROWS, COLUMNS) means of green, 0 to 255, of every n-th pixel."""
    step = max(1, min(picture.shape[:2]) // SAMPLED_PX)
    sampled = np.ascontiguousarray(picture[::step, ::step, 1])
    small = cv2.resize(sampled, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.float32)
