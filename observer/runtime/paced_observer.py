"""Looks at a picture only when there can be something new in it (pacing.py)."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.load import LoadMeter
from observer.camera.base import Picture
from observer.runtime.pacing import COLUMNS, ROWS, Cells, MotionGate, TrackingPace
from observer.runtime.pipeline import Posterior
from observer.runtime.service import ObserverAround, ObserverLike
from observer.tracks import Floats, Frame, Tracker, Tracks

if TYPE_CHECKING:
    from observer.runtime.prepared_tracker import PreparedTracker

GATE_HZ, EMPTY_GATE_HZ = 30.0, 15.0
"""Pictures that come faster are not all compared; in an empty room, where nobody can begin a movement, even fewer."""
SAMPLED_PX = 240
"""Of a picture about so many rows or columns are read, whichever are fewer."""
RESTING_RUNS = 4
"""While nothing changes, tracks are the mean of so many runs: the parts stay, only the tracker trembles."""
HEARTBEAT, EMPTY_HEARTBEAT = 0.45, 0.2
"""Posteriors are repeated after this share of fresh_s, so that they stay fresh, and when nobody is there, after this
share of drop_s: an observer that sees nobody has no posterior to keep fresh, and must only not seem dead."""


class HeldTracker:
    """A tracker that can be told to find what it found last; all else is the tracker's own.

    hold: return the last tracks. resting: nothing changes, so return the mean of the last RESTING_RUNS runs.
    cost_s: CPU seconds of the last run, by the clock `cpu_s`.
    """

    def __init__(self, tracker: Tracker, cpu_s: Callable[[], float] = time.process_time) -> None:
        self._tracker, self._cpu_s = tracker, cpu_s
        self._runs: deque[Floats] = deque(maxlen=RESTING_RUNS)
        self._last: Tracks | None = None
        self.hold, self.resting, self.cost_s = False, False, 0.0

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - attributes of some trackers only, such as `skin`
        return getattr(self._tracker, name)

    @property
    def body_parts(self) -> Sequence[str]:
        """The body parts of the tracker."""
        return self._tracker.body_parts

    def update(self, frame: Frame) -> Tracks:
        """The tracks in this frame, or the last ones."""
        if self._last is None or not self.hold:
            begun_s = self._cpu_s()
            tracks = self._tracker.update(frame)
            self.cost_s = self._cpu_s() - begun_s
            self._last = self._settled(tracks)
        return self._last

    def _settled(self, tracks: Tracks) -> Tracks:
        if not self.resting:
            self._runs.clear()
            return tracks
        self._runs.append(tracks.centres)
        runs = np.array(self._runs)
        visible = np.isfinite(runs)
        means = np.where(visible, runs, 0.0).sum(axis=0) / np.maximum(visible.sum(axis=0), 1)
        return replace(tracks, centres=np.where(np.isfinite(tracks.centres), means, np.nan))


class PacedObserver(ObserverAround):
    """An `ObserverLike` that skips pictures, which then have no posterior.

    prepared: the tracker that `observer` steps. fusion: which posteriors stay fresh. While nobody moves and the
    pictures do not change, the observer is stepped with the last tracks as a heartbeat: they are as true of the newest
    picture as of the one that they were found in.
    """

    def __init__(
        self,
        observer: ObserverLike,
        prepared: "PreparedTracker",
        pace: TrackingPace,
        fusion: FusionConfig,
        meter: LoadMeter,
        cpu_s: Callable[[], float] = time.process_time,
    ) -> None:
        super().__init__(observer, meter)
        self._late = meter
        self._prepared, self._pace, self._fusion = prepared, pace, fusion
        prepared.tracker = self._held = HeldTracker(prepared.tracker, cpu_s)
        self._gate, self._skipped = MotionGate(), False
        self._compared_ns = self._stepped_ns = self._lost = 0

    def step(self, frame: Frame) -> Posterior | None:
        """The posterior after one more frame; None if it was skipped. The last one of a recording never is."""
        if frame.repeated:
            return None if self._skipped else self._observer.step(frame)
        at_ns = frame.captured_ns
        self._lost += frame.skipped
        missed = self._pace.missed(at_ns, self._lost)
        due = self._pace.due(at_ns, self._changed(frame)) or frame.last
        self._skipped = not due and not (self._pace.quiet(at_ns) and self._heartbeat_due(at_ns))
        if self._skipped:
            return None
        self._stepped_ns = at_ns
        if due:
            self._late.record(at_ns, missed)
            self._lost = 0
        self._held.hold, self._held.resting = not due, self._pace.quiet(at_ns)
        posterior = self._observer.step(frame)
        if due and (tracks := self._prepared.tracks_of_all) is not None:
            self._pace.ran(at_ns, tracks, self._held.cost_s)
        return posterior

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
        fusion = self._fusion
        heartbeat_s = EMPTY_HEARTBEAT * fusion.drop_s if self._pace.empty else HEARTBEAT * fusion.fresh_s
        return not 0 <= at_ns - self._stepped_ns < heartbeat_s * SECOND_NS


def cells_of(picture: Picture) -> Cells:
    """(H, W, 3) -> (ROWS, COLUMNS) means of green, 0 to 255, of every n-th pixel."""
    step = max(1, min(picture.shape[:2]) // SAMPLED_PX)
    sampled = np.ascontiguousarray(picture[::step, ::step, 1])
    small = cv2.resize(sampled, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.float32)
