"""One fusion process, simulated: posteriors arrive, a loop judges what is due, each step at its measured cost. Pure.

1. A process of many scenes keeps the newest posterior of each observer. It judges each scene `step_hz` times a second,
   scenes that are due together in one batch, and publishes a status per scene and second (fusion/server.py).
2. A process of one scene judges as soon as a posterior arrives, and at least `step_hz` times a second.
3. Missed steps are not repeated: a process that cannot keep up judges less often.
4. Zenoh's threads and the loop use at most one core each; where both share one core, the loop is slower.
"""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from benchmarks.scale.measured import WAKE_RANKS, Costs

PAUSE_S = 0.008
TOGETHER = 32
STATUS_S = 1.0
MICRO = 1e-6
GOLDEN = 0.6180339887
APART_S = 30e-6
"""Between the messages of observers that see the same frame at the same time."""


@dataclass(frozen=True, slots=True)
class Load:
    """The messages of each scene's observers, and the settings of the process.

    in_step: the observers of a scene publish together, as cameras with a common trigger; else each at its own time.
    jitter_s: variation of these times. bursts_hz: how often several of many observers publish together (measured at
    240). cores: available to the process. wake_ms: wake-up delays (CrowdRun). poll_s: polling interval of the receiver.
    """

    rate_hz: float = 30.0
    step_hz: float = 10.0
    observers: int = 4
    in_step: bool = False
    jitter_s: float = 0.001
    bursts_hz: float = 240.0
    cores: float = 2.0
    poll_s: float = 0.0
    wake_ms: tuple[float, ...] = (0.0,) * len(WAKE_RANKS)


@dataclass(frozen=True, slots=True)
class Stay:
    """The time in which a process owns a scene, given by its number."""

    scene: int
    begin_s: float = 0.0
    end_s: float = float("inf")


@dataclass(slots=True)
class ProcessTrace:
    """The run of a process. published_s, age_s: of each judgement its time, and the age of its newest frame."""

    seconds: float
    published_s: list[float] = field(default_factory=list)
    scene: list[int] = field(default_factory=list)
    age_s: list[float] = field(default_factory=list)
    loop_s: float = 0.0
    threads_s: float = 0.0

    @property
    def core_share(self) -> float:
        """Share of one core, all threads."""
        return (self.loop_s + self.threads_s) / self.seconds

    @property
    def loop_share(self) -> float:
        """Share of one core of the loop's thread: at 1 the process is full, however many cores there are."""
        return self.loop_s / self.seconds

    @property
    def judgements_hz(self) -> float:
        """Judgements per second of all scenes."""
        return len(self.published_s) / self.seconds

    def age_ms(self, percent: float) -> float:
        """A percentile of the ages of the judgements."""
        return float(np.percentile(self.age_s, percent)) * 1e3 if self.age_s else float("inf")


def simulate_one(costs: Costs, load: Load, seconds: float, seed: int = 0) -> ProcessTrace:
    """A process of one scene."""
    process = _SimulatedProcess(costs, load, (Stay(0),), seconds, seed, called=True)
    process.judge_arrivals()
    return process.trace


def simulate_many(
    costs: Costs, load: Load, stays: Iterable[Stay], seconds: float, known: int = 0, seed: int = 0
) -> ProcessTrace:
    """A process of many scenes that owns `stays` and knows `known` scenes (default: those)."""
    process = _SimulatedProcess(costs, load, tuple(stays), seconds, seed)
    process.judge_in_turn(known or len(process.stays))
    return process.trace


class _SimulatedProcess:
    def __init__(
        self, costs: Costs, load: Load, stays: Sequence[Stay], seconds: float, seed: int, *, called: bool = False
    ) -> None:
        self.costs, self.load, self.stays, self.called = costs, load, stays, called
        rng = np.random.default_rng((seed, len(stays)))
        self.frames = [_frames(load, seconds, stay.scene, np.random.default_rng((seed, stay.scene))) for stay in stays]
        self.read = [
            [bisect_right(times, stay.begin_s) for times in own] for stay, own in zip(stays, self.frames, strict=True)
        ]
        self.polls = (rng.random(4096) * load.poll_s).tolist()
        self.wakes = (np.interp(rng.random(4096), WAKE_RANKS, load.wake_ms) * 1e-3).tolist()
        self.trace = ProcessTrace(seconds)
        self.now_s, self._turns = 0.0, 0
        self.hop_s = costs.hop * MICRO
        self._add_threads()

    def judge_in_turn(self, known: int) -> None:
        """The loop of a process of many scenes."""
        period_s, status_s = 1 / self.load.step_hz, 0.0
        self._due_s = [max(stay.begin_s, n / len(self.stays) * period_s) for n, stay in enumerate(self.stays)]
        self._owned = [stay.begin_s <= 0 for stay in self.stays]
        while self.now_s < self.trace.seconds:
            self._work(self.costs.turn + self.costs.round * known)
            due = self._due(period_s)
            while batch := list(islice(due, TOGETHER)):
                captured_s = [self._receive(n) for n in batch]
                self._work(self.costs.cold + self.costs.judge * len(batch))
                for n, newest_s in zip(batch, captured_s, strict=True):
                    self._publish(n, newest_s)
            if self.now_s - status_s >= STATUS_S:
                status_s = self.now_s
                self._work(self.costs.status * sum(stay.begin_s <= self.now_s < stay.end_s for stay in self.stays))
            self._sleep(PAUSE_S)

    def _due(self, period_s: float) -> Iterator[int]:
        for n, stay in enumerate(self.stays):
            behind_s = self.now_s - self._due_s[n]
            if behind_s >= 0 and stay.begin_s <= self.now_s < stay.end_s:
                self._due_s[n] += period_s * (1 + behind_s // period_s)
                if not self._owned[n]:
                    self._owned[n] = True
                    self._work(self.costs.take_over)
                yield n

    def judge_arrivals(self) -> None:
        """The loop of a process of one scene."""
        period_s, status_s = 1 / self.load.step_hz, 0.0
        while self.now_s < self.trace.seconds:
            nexts = [times[n] for times, n in zip(self.frames[0], self.read[0], strict=True) if n < len(times)]
            next_s = min(nexts, default=float("inf")) + self.hop_s
            if next_s > self.now_s:
                self._sleep(min(next_s - self.now_s, period_s))
            captured_s = self._receive(0)
            self._work(self.costs.turn + self.costs.cold + self.costs.judge)
            self._publish(0, captured_s)
            if self.now_s - status_s >= STATUS_S:
                status_s = self.now_s
                self._work(self.costs.status)

    def _receive(self, n: int) -> float | None:
        """Take and decode the posteriors of a scene; the capture time of its newest frame."""
        own, read, arrived_by_s = self.frames[n], self.read[n], self.now_s - self.hop_s
        count = 0
        for observer, times in enumerate(own):
            upto = bisect_right(times, arrived_by_s)
            arrived = upto - read[observer]
            count += arrived if self.called else min(arrived, 1)
            read[observer] = upto
        take = 0.0 if self.called else self.costs.take
        self._work((take + self.costs.decode) * count)
        return max((times[upto - 1] for times, upto in zip(own, read, strict=True) if upto), default=None)

    def _publish(self, n: int, captured_s: float | None) -> None:
        self._work(self.costs.publish)
        if captured_s is not None:
            self.trace.published_s.append(self.now_s)
            self.trace.scene.append(self.stays[n].scene)
            poll_s = self.polls[len(self.trace.age_s) % len(self.polls)]
            self.trace.age_s.append(self.now_s + self.hop_s + poll_s - captured_s)

    def _add_threads(self) -> None:
        """The time of Zenoh's threads, the same all the time."""
        load, seconds = self.load, self.trace.seconds
        stayed_s = sum(min(stay.end_s, seconds) - min(stay.begin_s, seconds) for stay in self.stays)
        arrivals = stayed_s * load.observers * load.rate_hz
        bursts = min(arrivals / (load.observers if load.in_step else 1), seconds * load.bursts_hz)
        each = self.costs.call if self.called else self.costs.receive
        self.trace.threads_s = (arrivals * each + bursts * self.costs.burst) * MICRO
        left = load.cores - self.trace.threads_s / seconds
        self._slowness = 1 / min(max(left, 0.01), 1.0)

    def _work(self, cost: float) -> None:
        self.trace.loop_s += cost * MICRO
        self.now_s += cost * MICRO * self._slowness

    def _sleep(self, pause_s: float) -> None:
        self._turns += 1
        self.now_s += pause_s + self.wakes[self._turns % len(self.wakes)]


def _frames(load: Load, seconds: float, scene: int, rng: np.random.Generator) -> list[list[float]]:
    """The publishing times of each observer of a scene, in order; the first is before the begin."""
    count = int((seconds + 1) * load.rate_hz) + 2
    frames, together = [], rng.uniform(-load.jitter_s, load.jitter_s, count)
    for observer in range(load.observers):
        # The golden ratio spreads any number of observers evenly, and no two begin together.
        begin = (scene if load.in_step else scene * load.observers + observer) * GOLDEN % 1
        jitter = together if load.in_step else rng.uniform(-load.jitter_s, load.jitter_s, count)
        times = (np.arange(count) + begin - 1) / load.rate_hz + observer * APART_S + jitter
        frames.append(np.sort(times).tolist())
    return frames
