"""One fusion process, simulated: posteriors come, a loop judges what is due, each step at its measured cost. Pure.

1. Who judges many scenes: of each observer the newest posterior waits; each scene is judged `step_hz` times a second,
   those that are due together are judged together; a status a scene and second
   (fusion/server.py).
2. Who judges one: as soon as something has come, and `step_hz` times a second (fusion/server.py).
3. Steps that were missed are not made up for: who cannot keep up judges less often.
4. Zenoh's threads and the loop need a core each, at most; where they have but one between them the loop is slower.
"""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from benchmarks.scale.measured import WAKE_RANKS, Costs

PAUSE_S = 0.008
TOGETHER = 32
TELL_S = 1.0
MICRO = 1e-6
GOLDEN = 0.6180339887
APART_S = 30e-6
"""Between the words of observers who see the same frame at the same time."""


@dataclass(frozen=True, slots=True)
class Load:
    """What the observers of each scene say, and how the process is set.

    in_step: those of a scene speak at the same time, as cameras with a common trigger; else each at its own.
    jitter_s: so much earlier or later. bursts_hz: of many observers, so many times a second some come at once (measured
    at 240). cores: that the process may use. wake_ms: how late it is woken (Run). ear_s: so often who listens looks.
    """

    rate_hz: float = 30.0
    step_hz: float = 10.0
    observers: int = 4
    in_step: bool = False
    jitter_s: float = 0.001
    bursts_hz: float = 240.0
    cores: float = 2.0
    ear_s: float = 0.0
    wake_ms: tuple[float, ...] = (0.0,) * len(WAKE_RANKS)


@dataclass(frozen=True, slots=True)
class Stay:
    """A scene, by its number, is this process's from one time to another."""

    scene: int
    begin_s: float = 0.0
    end_s: float = float("inf")


@dataclass(slots=True)
class Trace:
    """What a process did. said_s, age_s: of each judgement when it was said, how old the newest frame in it was."""

    seconds: float
    said_s: list[float] = field(default_factory=list)
    scene: list[int] = field(default_factory=list)
    age_s: list[float] = field(default_factory=list)
    loop_s: float = 0.0
    threads_s: float = 0.0

    @property
    def core_share(self) -> float:
        """Of one core, all threads."""
        return (self.loop_s + self.threads_s) / self.seconds

    @property
    def loop_share(self) -> float:
        """Of the loop's thread alone: at 1 the process is full, however many cores there are."""
        return self.loop_s / self.seconds

    @property
    def judgements_hz(self) -> float:
        """Judgements a second, of all scenes."""
        return len(self.said_s) / self.seconds

    def age_ms(self, percent: float) -> float:
        """Of the judgements."""
        return float(np.percentile(self.age_s, percent)) * 1e3 if self.age_s else float("inf")


def alone(costs: Costs, load: Load, seconds: float, seed: int = 0) -> Trace:
    """A process of one scene."""
    process = _Process(costs, load, (Stay(0),), seconds, seed, called=True)
    process.judge_what_comes()
    return process.trace


def shared(costs: Costs, load: Load, stays: Iterable[Stay], seconds: float, known: int = 0, seed: int = 0) -> Trace:
    """A process of many scenes, of which it judges `stays`; it knows `known`, or as many as it judges."""
    process = _Process(costs, load, tuple(stays), seconds, seed)
    process.judge_in_turn(known or len(process.stays))
    return process.trace


class _Process:
    def __init__(
        self, costs: Costs, load: Load, stays: Sequence[Stay], seconds: float, seed: int, *, called: bool = False
    ) -> None:
        self.costs, self.load, self.stays, self.called = costs, load, stays, called
        rng = np.random.default_rng((seed, len(stays)))
        self.frames = [_frames(load, seconds, stay.scene, np.random.default_rng((seed, stay.scene))) for stay in stays]
        self.read = [
            [bisect_right(times, stay.begin_s) for times in own] for stay, own in zip(stays, self.frames, strict=True)
        ]
        self.ears = (rng.random(4096) * load.ear_s).tolist()
        self.wakes = (np.interp(rng.random(4096), WAKE_RANKS, load.wake_ms) * 1e-3).tolist()
        self.trace = Trace(seconds)
        self.now_s, self._turns = 0.0, 0
        self.hop_s = costs.hop * MICRO
        self._hear_threads()

    def judge_in_turn(self, known: int) -> None:
        """The loop of a process of many scenes."""
        period_s, told_s = 1 / self.load.step_hz, 0.0
        self._due_s = [max(stay.begin_s, n / len(self.stays) * period_s) for n, stay in enumerate(self.stays)]
        self._sitting = [stay.begin_s <= 0 for stay in self.stays]
        while self.now_s < self.trace.seconds:
            self._work(self.costs.turn + self.costs.round * known)
            due = self._due(period_s)
            while batch := list(islice(due, TOGETHER)):
                captured_s = [self._hear(n) for n in batch]
                self._work(self.costs.cold + self.costs.judge * len(batch))
                for n, newest_s in zip(batch, captured_s, strict=True):
                    self._say(n, newest_s)
            if self.now_s - told_s >= TELL_S:
                told_s = self.now_s
                self._work(self.costs.tell * sum(stay.begin_s <= self.now_s < stay.end_s for stay in self.stays))
            self._sleep(PAUSE_S)

    def _due(self, period_s: float) -> Iterator[int]:
        for n, stay in enumerate(self.stays):
            behind_s = self.now_s - self._due_s[n]
            if behind_s >= 0 and stay.begin_s <= self.now_s < stay.end_s:
                self._due_s[n] += period_s * (1 + behind_s // period_s)
                if not self._sitting[n]:
                    self._sitting[n] = True
                    self._work(self.costs.sit)
                yield n

    def judge_what_comes(self) -> None:
        """The loop of a process of one scene."""
        period_s, told_s = 1 / self.load.step_hz, 0.0
        while self.now_s < self.trace.seconds:
            nexts = [times[n] for times, n in zip(self.frames[0], self.read[0], strict=True) if n < len(times)]
            next_s = min(nexts, default=float("inf")) + self.hop_s
            if next_s > self.now_s:
                self._sleep(min(next_s - self.now_s, period_s))
            captured_s = self._hear(0)
            self._work(self.costs.turn + self.costs.cold + self.costs.judge)
            self._say(0, captured_s)
            if self.now_s - told_s >= TELL_S:
                told_s = self.now_s
                self._work(self.costs.tell)

    def _hear(self, n: int) -> float | None:
        """What has come of a scene is taken and heard; when the newest frame in it was captured."""
        own, read, come_by_s = self.frames[n], self.read[n], self.now_s - self.hop_s
        heard = 0
        for observer, times in enumerate(own):
            upto = bisect_right(times, come_by_s)
            came = upto - read[observer]
            heard += came if self.called else min(came, 1)
            read[observer] = upto
        take = 0.0 if self.called else self.costs.take
        self._work((take + self.costs.hear) * heard)
        return max((times[upto - 1] for times, upto in zip(own, read, strict=True) if upto), default=None)

    def _say(self, n: int, captured_s: float | None) -> None:
        self._work(self.costs.say)
        if captured_s is not None:
            self.trace.said_s.append(self.now_s)
            self.trace.scene.append(self.stays[n].scene)
            ear_s = self.ears[len(self.trace.age_s) % len(self.ears)]
            self.trace.age_s.append(self.now_s + self.hop_s + ear_s - captured_s)

    def _hear_threads(self) -> None:
        """What Zenoh's threads spend, all the time alike."""
        load, seconds = self.load, self.trace.seconds
        stayed_s = sum(min(stay.end_s, seconds) - min(stay.begin_s, seconds) for stay in self.stays)
        came = stayed_s * load.observers * load.rate_hz
        bursts = min(came / (load.observers if load.in_step else 1), seconds * load.bursts_hz)
        each = self.costs.call if self.called else self.costs.receive
        self.trace.threads_s = (came * each + bursts * self.costs.burst) * MICRO
        left = load.cores - self.trace.threads_s / seconds
        self._slowness = 1 / min(max(left, 0.01), 1.0)

    def _work(self, cost: float) -> None:
        self.trace.loop_s += cost * MICRO
        self.now_s += cost * MICRO * self._slowness

    def _sleep(self, pause_s: float) -> None:
        self._turns += 1
        self.now_s += pause_s + self.wakes[self._turns % len(self.wakes)]


def _frames(load: Load, seconds: float, scene: int, rng: np.random.Generator) -> list[list[float]]:
    """When each observer of a scene speaks, in order; the first before the beginning."""
    count = int((seconds + 1) * load.rate_hz) + 2
    spoken, together = [], rng.uniform(-load.jitter_s, load.jitter_s, count)
    for observer in range(load.observers):
        # By the golden ratio no two begin alike, and however few they are spread evenly.
        begin = (scene if load.in_step else scene * load.observers + observer) * GOLDEN % 1
        jitter = together if load.in_step else rng.uniform(-load.jitter_s, load.jitter_s, count)
        times = (np.arange(count) + begin - 1) / load.rate_hz + observer * APART_S + jitter
        spoken.append(np.sort(times).tolist())
    return spoken
