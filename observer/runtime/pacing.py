"""An observer that looks at a picture only when there can be something new in it.

1. While the person moves the tracker is run `max_hz` times a second; by default as often as ACTIVE_SHARE of a core
   allows.
2. A person whose body parts have stayed where they are for STILL_S, in pictures that do not change (`MotionGate`), is
   at rest: then `idle_hz`; by default what costs REST_SHARE of a core, and at least LEAST_IDLE_HZ.
3. If the tracker has found nobody for NOBODY_S, and the pictures do not change, it searches as often as costs
   EMPTY_SHARE of a core, and never more often than at rest.
4. A change in the picture ends 2 and 3 with that picture, for HOLD_S.
5. While pictures change and nobody has been found for LOST_S, runs follow each other ever later, down to SEARCH_SHARE
   of a core.
"""

from collections import deque
from statistics import median

import cv2
import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.load import LoadMeter
from observer.prepared_tracks import PreparedTracker
from observer.runtime.pipeline import Posterior
from observer.runtime.service import ObserverAround, ObserverLike
from observer.tracks import Floats, Frame, Picture, State, Tracks

ACTIVE_SHARE, SEARCH_SHARE, REST_SHARE, EMPTY_SHARE = 0.4, 0.06, 0.04, 0.005
"""Shares of a core that the tracker may take: of a moving person, of nobody while pictures change, of a person at rest,
of an empty room. With reading and publishing the process stays below half a core, and 5 % when nobody is there."""
LEAST_IDLE_HZ, MOST_EMPTY_HZ, LEAST_EMPTY_HZ = 2.0, 2.0, 0.05
STILL_S, STILL = 1.0, 0.12
"""A person is still whose parts stayed this long within this share of the distance between their farthest parts."""
STILL_PX = 2.0
"""Tracks that stay within so many pixels are still, whatever the distance."""
LOST_S, NOBODY_S = 2.0, 6.0
"""A person who is hidden for less than the first is searched at full rate. The second is longer than a tracker takes to
complain that it finds nobody."""
HOLD_S = 0.5
SLOWER = 1.25
"""Factor on the time between two runs after each that found nobody (rule 5)."""
COSTS = 9
"""The cost of a run is the median of so many: single ones are disturbed."""


class TrackingPace:
    """Decides for each picture whether the tracker is run. Times are capture times, ns.

    max_hz, idle_hz: runs of the tracker per second, as in [observers.ID]; None: by their cost.
    """

    def __init__(self, max_hz: float | None = None, idle_hz: float | None = None) -> None:
        self._max_hz, self._idle_hz = max_hz, idle_hz
        self._costs: deque[float] = deque(maxlen=COSTS)
        self._empty_costs: deque[float] = deque(maxlen=COSTS)
        self._tracks: deque[tuple[int, Floats]] = deque()
        self._ran_ns: int | None = None
        self._someone_ns: int | None = None
        self._moved_ns: int | None = None
        self._due_ns, self._before_ns, self._period_ns = 0, 0, 0.0
        self._fruitless, self._still = 0, False
        self.empty = False
        """Whether the tracker has found nobody for NOBODY_S."""

    @property
    def confirmed_quiet(self) -> bool:
        """Whether by the tracker's last run nobody moves: the person is still, or nobody has been there for long."""
        return self._still or self.empty

    def quiet(self, at_ns: int) -> bool:
        """Whether nobody moves and nothing has changed for HOLD_S: the last tracks are valid for this picture too."""
        changed = self._moved_ns is not None and at_ns - self._moved_ns < HOLD_S * SECOND_NS
        return self.confirmed_quiet and not changed

    def due(self, at_ns: int, changed: bool) -> bool:
        """Whether to run the tracker on this picture. changed: it differs from those before (`MotionGate`)."""
        was_quiet = self.quiet(at_ns)
        if self._before_ns and not 0 <= at_ns - self._before_ns <= SECOND_NS:
            self._due_ns = at_ns  # the clock was set, or the camera was away
        elif self._before_ns:
            self._period_ns += (at_ns - self._before_ns - self._period_ns) * (0.1 if self._period_ns else 1.0)
        self._before_ns = at_ns
        if changed:
            self._moved_ns = at_ns
            if was_quiet:
                self._fruitless, self._due_ns = 0, at_ns
        # The picture nearest to the moment at which a run is due.
        return at_ns + self._period_ns / 2 >= self._due_ns

    def missed(self, at_ns: int, skipped: int) -> int:
        """How many of the `skipped` pictures since the last run the tracker should have seen."""
        if not skipped or self._ran_ns is None:
            return 0
        due = (at_ns - self._ran_ns) / SECOND_NS * self.rate_hz(at_ns)
        return int(min(skipped, max(due - 1, 0.0)))

    def ran(self, at_ns: int, tracks: Tracks, cost_s: float) -> None:
        """Note that the tracker was run on this picture, and took so many CPU seconds."""
        self._ran_ns = at_ns
        was_empty = self.empty and self.quiet(at_ns)
        (self._empty_costs if was_empty else self._costs).append(max(cost_s, 1e-6))
        someone = any(state is not State.MISSING for state in tracks.states)
        if someone or self._someone_ns is None or at_ns < self._someone_ns:
            self._someone_ns = at_ns
        lost = at_ns - self._someone_ns >= LOST_S * SECOND_NS
        self._fruitless = self._fruitless + 1 if lost else 0
        self.empty = at_ns - self._someone_ns >= NOBODY_S * SECOND_NS
        self._still = someone and self._stays(at_ns, tracks.centres)
        interval_ns = SECOND_NS / self.rate_hz(at_ns)
        # Runs keep their average rate although pictures come when they come.
        self._due_ns = max(self._due_ns + round(interval_ns), at_ns)

    def rate_hz(self, at_ns: int) -> float:
        """Runs of the tracker per second at this time; infinite: each picture."""
        cost_s = median(self._costs) if self._costs else 0.0
        active_hz = self._max_hz or _within(ACTIVE_SHARE, cost_s)
        idle_hz = min(self._idle_hz or max(_within(REST_SHARE, cost_s), LEAST_IDLE_HZ), active_hz)
        if self.quiet(at_ns):
            if not self.empty:
                return idle_hz
            empty_s = median(self._empty_costs) if self._empty_costs else cost_s
            return min(max(min(_within(EMPTY_SHARE, empty_s), MOST_EMPTY_HZ), LEAST_EMPTY_HZ), idle_hz)
        slowest_hz = min(active_hz, max(_within(SEARCH_SHARE, cost_s), LEAST_IDLE_HZ))
        return max(active_hz / SLOWER ** min(self._fruitless, 100), slowest_hz)

    def _stays(self, at_ns: int, centres: Floats) -> bool:
        """Whether all parts that are seen have stayed in one place for STILL_S."""
        # A model that was taught meanwhile may read other parts.
        if self._tracks and (at_ns < self._tracks[-1][0] or centres.shape != self._tracks[-1][1].shape):
            self._tracks.clear()
        self._tracks.append((at_ns, centres))
        while len(self._tracks) > 1 and self._tracks[1][0] <= at_ns - STILL_S * SECOND_NS:
            self._tracks.popleft()
        if at_ns - self._tracks[0][0] < STILL_S * SECOND_NS:
            return False
        return is_still(np.array([places for _, places in self._tracks]))


def _within(share: float, cost_s: float) -> float:
    return share / cost_s if cost_s else float("inf")


def is_still(places: Floats) -> bool:
    """(T, P, 2) px, NaN where not seen -> whether each part that is seen more than once stays in one place."""
    visible = np.isfinite(places).all(axis=2).any(axis=0)
    if not visible.any():
        return False
    most, least = np.nanmax(places[:, visible], axis=0), np.nanmin(places[:, visible], axis=0)
    middles = (most + least) / 2
    size = max((float(np.hypot(*(one - other))) for n, one in enumerate(middles) for other in middles[:n]), default=0.0)
    ways = np.hypot(*(most - least).T)
    return bool(ways.max() <= max(STILL * size, STILL_PX))


Cells = NDArray[np.float32]

ROWS, COLUMNS = 60, 80
AVERAGE_S, LEARN_S = 0.7, 3.0
CELLS, LEAST_GREY, NOISES = 2, 4.0, 6.0
LEARN_EVERY_S, WAITS_S = 0.1, 0.5
"""A difference is learned as noise only if so much later nobody has moved: the begin of a movement is none."""
MOST_CHANGED = 0.6
"""If more of the cells have changed the light has, or the camera: the mean starts over."""


class MotionGate:
    """Notices that something begins to move in pictures of nobody who moves; far cheaper than a tracker.

    A picture of ROWS x COLUMNS cells of grey has changed if CELLS of them or more differ from their mean over the last
    AVERAGE_S by more than LEAST_GREY and by more than NOISES times what they differ by while nobody moves, which is
    learned cell by cell. Before the comparison the mean is brought to the picture's brightness.
    """

    def __init__(self) -> None:
        self._mean: Cells | None = None
        self._variance = np.zeros((ROWS, COLUMNS), np.float32)
        self._limit = np.full((ROWS, COLUMNS), LEAST_GREY, np.float32)
        self._waiting: deque[tuple[int, Cells, float]] = deque()
        self._before_ns, self._unlearned_s = 0, 0.0

    def forget(self) -> None:
        """Begin anew with the next picture, because somebody moves. What was learned about noise stays."""
        self._mean = None
        self._waiting.clear()

    def update(self, cells: Cells, at_ns: int) -> bool:
        """Whether this picture, captured at `at_ns`, has changed."""
        seconds = min(max((at_ns - self._before_ns) / SECOND_NS, 0.0), 1.0)
        self._before_ns = at_ns
        if self._mean is None:
            self._mean = cells.copy()
            return False
        mean = self._mean * _brighter(cells, self._mean)
        change = cells - mean
        difference = np.abs(change)
        count = int(np.count_nonzero(difference > self._limit))
        if count > MOST_CHANGED * difference.size:
            self._mean = cells.copy()
            self._waiting.clear()
            return True
        step = np.float32(min(seconds / AVERAGE_S, 1.0))
        self._mean = np.asarray(mean + change * step, np.float32)
        self._unlearned_s += seconds
        if self._unlearned_s >= LEARN_EVERY_S:
            self._learn(difference, at_ns, self._unlearned_s)
            self._unlearned_s = 0.0
        return count >= CELLS

    def _learn(self, difference: Cells, at_ns: int, seconds: float) -> None:
        self._waiting.append((at_ns, difference, seconds))
        changed = False
        while self._waiting and not 0 <= at_ns - self._waiting[0][0] < WAITS_S * SECOND_NS:
            _, noise, lasted_s = self._waiting.popleft()
            self._variance += (noise * noise - self._variance) * np.float32(min(lasted_s / LEARN_S, 1.0))
            changed = True
        if changed:
            self._limit = np.maximum(np.float32(LEAST_GREY), np.float32(NOISES) * np.sqrt(self._variance))


def _brighter(cells: Cells, mean: Cells) -> np.float32:
    """The factor by which the picture is brighter than the mean: the median over every fifth row and column."""
    ratios = np.sort(((cells[::5, ::5] + 1) / (mean[::5, ::5] + 1)).ravel())
    return np.float32(ratios[len(ratios) // 2])  # np.median takes longer than all the rest


GATE_HZ, EMPTY_GATE_HZ = 30.0, 15.0
"""Pictures that come faster are not all compared; in an empty room, where nobody can begin a movement, even fewer."""
SAMPLED_PX = 240
"""Of a picture about so many rows or columns are read, whichever are fewer."""
HEARTBEAT, EMPTY_HEARTBEAT = 0.45, 0.2
"""Posteriors are repeated after this share of fresh_s, so that they stay fresh, and when nobody is there, after this
share of drop_s: an observer that sees nobody has no posterior to keep fresh, and must only not seem dead."""


class PacedObserver(ObserverAround):
    """An `ObserverLike` that skips pictures, which then have no posterior.

    tracker: the one that `observer` steps. fusion: which posteriors stay fresh. While nobody moves and the pictures do
    not change, the observer is stepped with the last tracks as a heartbeat: they are true of the newest picture too.
    """

    def __init__(
        self,
        observer: ObserverLike,
        tracker: PreparedTracker,
        pace: TrackingPace,
        fusion: FusionConfig,
        meter: LoadMeter,
    ) -> None:
        super().__init__(observer, meter)
        self._late, self._tracker, self._pace, self._fusion = meter, tracker, pace, fusion
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
        self._tracker.hold, self._tracker.resting = not due, self._pace.quiet(at_ns)
        posterior = self._observer.step(frame)
        if due and (tracks := self._tracker.tracks_of_all) is not None:
            self._pace.ran(at_ns, tracks, self._tracker.cost_s)
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
