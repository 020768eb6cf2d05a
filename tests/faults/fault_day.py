"""A day of traffic in minutes: four observers and a fusion service, each with a Zenoh session, and a clock that is set.
Frame by frame the clock advances, all observers publish, and their judgement is awaited: nothing is left out, however
fast the machine is, and every age, hold and timeout is that of the day."""

import gc
import threading
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from processes import SOON_S

from common import SECOND_NS
from common.config import FusionConfig, MeshConfig, ObserverConfig, Scene
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage, VerdictMessage, VocabularyReference
from common.status import ProcessStatus, StatusPublisher
from common.vocabulary import Vocabulary
from common.wire import decode, encode
from fusion.server import serve

NAMES = Vocabulary(("bowing", "lunging", "byebye", "stretch"))
REFERENCE = VocabularyReference(name=NAMES.name, hash=NAMES.digest)
OBSERVERS = ("cam1", "cam2", "cam3", "cam4")
ROUND_S, MOVES_S = 20, 3
"""Every 20 s a movement of 3 s, each label in turn."""


@dataclass(frozen=True)
class Sample:
    """The resources of this process at one time of the day."""

    hour: float
    rss_kb: int
    descriptors: int
    threads: int


@dataclass
class Day:
    """The outcome. verdicts: for each id the labels that were published, and whether the movement had ended."""

    posteriors: int = 0
    judgements: int = 0
    verdicts: dict = field(default_factory=dict)
    samples: list = field(default_factory=list)

    def __str__(self):
        first, last, most_kb = self.samples[0], self.samples[-1], max(s.rss_kb for s in self.samples)
        counts = f"{self.posteriors} posteriors, {self.judgements} judgements, {len(self.verdicts)} verdicts"
        memory = f"memory {first.rss_kb / 1024:.1f} -> {last.rss_kb / 1024:.1f} MB, at most {most_kb / 1024:.1f}"
        return f"{last.hour:.1f} h: {counts}; {memory}; descriptors {first.descriptors} -> {last.descriptors}"


class Clock:
    """A time of day that is set."""

    def __init__(self):
        self.now_ns = 1_700_000_000 * SECOND_NS

    def __call__(self):
        return self.now_ns


def run_day(hours, rate_hz, every_h):
    """This many hours with `rate_hz` posteriors a second of each observer; resources are sampled every `every_h`."""
    observers = {name: ObserverConfig(source="none") for name in OBSERVERS}
    scene = Scene(scene="day", vocabulary=NAMES.labels, mesh=MeshConfig(mode="machine"), observers=observers,
                  fusion=FusionConfig(quorum=3))  # fmt: skip
    stop, clock = threading.Event(), Clock()
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as link, ExitStack() as stack:
        fusion = threading.Thread(target=serve, args=([scene], scene.fusion.id, link, stop, clock))
        fusion.start()
        stack.callback(fusion.join, SOON_S)
        stack.callback(stop.set)
        return Players(scene, scene.mesh.at(link.locator), clock, stack).play(hours, rate_hz, every_h)


class Players:
    """The observers' sessions and a hub's, which close with `stack`."""

    def __init__(self, scene, mesh, clock, stack):
        keys, self._clock, self._publishers = scene.keys, clock, {}
        hub = stack.enter_context(Link.open(mesh, "hub"))
        self._judgements, self._verdicts = hub.inbox(keys.judgement), hub.inbox(keys.verdict)
        for name in OBSERVERS:
            link = stack.enter_context(Link.open(mesh, "observer"))
            self._publishers[name] = link.publisher(keys.posterior(name))
            status = ProcessStatus("day", name)
            stack.enter_context(StatusPublisher(link, keys.observer_status(name), status, clock))
            link.announce(keys.observer_alive(name))
            assert self._publishers[name].wait_for_subscriber(SOON_S)

    def play(self, hours, rate_hz, every_h):
        day, begin_ns, sampled_h = Day(), self._clock.now_ns, -every_h
        for frame in range(round(hours * 3600 * rate_hz)):
            self._clock.now_ns = begin_ns + frame * round(SECOND_NS / rate_hz)
            second = (self._clock.now_ns - begin_ns) / SECOND_NS
            self._publish(frame, second)
            self._wait_for_judgement(day)
            day.posteriors += len(OBSERVERS)
            if second / 3600 - sampled_h >= every_h:
                sampled_h = second / 3600
                day.samples.append(sample(sampled_h))
                print(day.samples[-1])
        day.samples.append(sample(hours))
        self._take_verdicts(day)
        return day

    def _publish(self, frame, second):
        number, within_s = divmod(second, ROUND_S)
        moves = ROUND_S - MOVES_S - 2 <= within_s < ROUND_S - 2
        label, now_ns = int(number) % NAMES.size, self._clock.now_ns
        p = [0.94 if (n == label) else 0.02 for n in range(NAMES.size)] if moves else [1 / NAMES.size] * NAMES.size
        for name, publisher in self._publishers.items():
            message = PosteriorMessage(
                v=1, scene="day", observer=name, seq=frame, session="day", captured_ns=now_ns, sent_ns=now_ns,
                vocabulary=REFERENCE, p=p, rest=0.05 if moves else 0.98, frames=frame + 1,
                visible={"left_hand": True, "right_hand": True, "head": True},
            )  # fmt: skip
            publisher.put(encode(message))

    def _wait_for_judgement(self, day):
        """Until a judgement has all posteriors of this time; Zenoh on one machine loses nothing at this rate."""
        for _ in range(200):
            for arrival in self._judgements.take(0.1):
                judgement = decode(JudgementMessage, arrival.payload)
                day.judgements += 1
                ages = [vote.age_s for vote in judgement.votes.values()]
                if judgement.at_ns == self._clock.now_ns and all(age is not None and age < 0.05 for age in ages):
                    self._take_verdicts(day)
                    return
        raise AssertionError(f"no judgement of frame {day.posteriors // len(OBSERVERS)}")

    def _take_verdicts(self, day):
        for arrival in self._verdicts.take(0.0):
            verdict = decode(VerdictMessage, arrival.payload)
            day.verdicts.setdefault(verdict.id, []).append((verdict.label, verdict.ended_ns is not None))


def sample(hour):
    gc.collect()
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    descriptors = len(list(Path("/proc/self/fd").iterdir()))
    return Sample(hour, int(status["VmRSS"].split()[0]), descriptors, threading.active_count())
