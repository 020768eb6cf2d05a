"""A day of traffic in minutes: four observers and a fusion service, each with a Zenoh session, and a clock that is set.

Frame by frame: the clock goes on, all observers say what they believe, and the judgement of it is awaited. So nothing
is left out, however fast the machine is, and every age, hold and patience is that of the day.
"""

import gc
import threading
from dataclasses import dataclass, field
from pathlib import Path

from common import SECOND_NS
from common.config import FusionConfig, MeshConfig, ObserverConfig, Scene
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage, VerdictMessage, VocabularyReference
from common.status import ProcessStatus, StatusPublisher
from common.vocabulary import Vocabulary
from common.wire import decode, encode
from fusion.server import serve

NAMES = Vocabulary(("bowing", "lunging", "byebye", "stretch"))
OBSERVERS = ("cam1", "cam2", "cam3", "cam4")
ROUND_S, MOVES_S = 20, 3
"""Every 20 s a movement of 3 s, each label in turn."""
SOON_S = 10.0


@dataclass
class Sample:
    """What the process took at one time of the day."""

    hour: float
    rss_kb: int
    descriptors: int
    threads: int


@dataclass
class Day:
    """What came of it."""

    posteriors: int = 0
    judgements: int = 0
    sayings: dict = field(default_factory=dict)
    samples: list = field(default_factory=list)

    def told(self):
        """One line."""
        first, last, most_kb = self.samples[0], self.samples[-1], max(s.rss_kb for s in self.samples)
        said = f"{self.posteriors} posteriors, {self.judgements} judgements, {len(self.sayings)} verdicts"
        memory = f"memory {first.rss_kb / 1024:.1f} -> {last.rss_kb / 1024:.1f} MB, at most {most_kb / 1024:.1f}"
        return f"{last.hour:.1f} h: {said}; {memory}; descriptors {first.descriptors} -> {last.descriptors}"


def live(hours, rate_hz, every_h, tell=lambda line: None):
    """So many hours with `rate_hz` posteriors a second of each observer; memory is looked at `every_h` hours."""
    scene = Scene(
        scene="day",
        vocabulary=NAMES.labels,
        mesh=MeshConfig(mode="machine"),
        observers={name: ObserverConfig(source="none") for name in OBSERVERS},
        fusion=FusionConfig(quorum=3),
    )
    stop, clock = threading.Event(), Clock()
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as link:
        mesh = scene.mesh.at(link.locator)
        judging = threading.Thread(target=serve, args=([scene], scene.fusion.id, link, stop, clock))
        judging.start()
        try:
            with Players(scene, mesh, clock) as players:
                return players.play(hours, rate_hz, every_h, tell)
        finally:
            stop.set()
            judging.join(SOON_S)


class Clock:
    """A time of day that is set."""

    def __init__(self):
        self.now_ns = 1_700_000_000 * SECOND_NS

    def __call__(self):
        return self.now_ns


class Players:
    """The observers' sessions and a hub's; a context manager."""

    def __init__(self, scene, mesh, clock):
        self._keys, self._clock = scene.keys, clock
        self._links = {name: Link.open(mesh, "observer") for name in OBSERVERS}
        self._hub = Link.open(mesh, "hub")
        self._boards = []

    def __enter__(self):
        keys = self._keys
        self._judged, self._decided = self._hub.inbox(keys.judgement), self._hub.inbox(keys.verdict)
        self._mouths = {name: link.publisher(keys.posterior(name)) for name, link in self._links.items()}
        for name, link in self._links.items():
            board = StatusPublisher(link, keys.observer_status(name), ProcessStatus("day", name), self._clock)
            self._boards.append(board.__enter__())
            link.announce(keys.observer_alive(name))
            assert self._mouths[name].wait_for_subscriber(SOON_S)
        return self

    def __exit__(self, *_):
        for board in self._boards:
            board.__exit__(None, None, None)
        for link in (*self._links.values(), self._hub):
            link.close()

    def play(self, hours, rate_hz, every_h, tell):
        """Live through it."""
        day, begin_ns, frame_ns = Day(), self._clock.now_ns, round(SECOND_NS / rate_hz)
        looked_h = -every_h
        for frame in range(round(hours * 3600 * rate_hz)):
            self._clock.now_ns = begin_ns + frame * frame_ns
            self._say(frame, (frame * frame_ns) / SECOND_NS)
            self._await(day)
            day.posteriors += len(OBSERVERS)
            hour = frame * frame_ns / SECOND_NS / 3600
            if hour - looked_h >= every_h:
                looked_h = hour
                day.samples.append(sample(hour))
                tell(f"{day.samples[-1]}")
        day.samples.append(sample(hours))
        self._take_verdicts(day)
        return day

    def _say(self, frame, now_s):
        number, within_s = divmod(now_s, ROUND_S)
        moves = ROUND_S - MOVES_S - 2 <= within_s < ROUND_S - 2
        label = int(number) % NAMES.size
        p = [0.94 if (n == label) else 0.02 for n in range(NAMES.size)] if moves else [1 / NAMES.size] * NAMES.size
        for name, mouth in self._mouths.items():
            message = PosteriorMessage(
                scene="day",
                observer=name,
                seq=frame,
                session="day",
                captured_ns=self._clock.now_ns,
                sent_ns=self._clock.now_ns,
                vocabulary=VocabularyReference(name=NAMES.name, hash=NAMES.digest),
                p=p,
                rest=0.05 if moves else 0.98,
                frames=frame + 1,
                visible={"left_hand": True, "right_hand": True, "head": True},
            )
            mouth.put(encode(message))

    def _await(self, day):
        """Until a judgement has all that was said at this time; Zenoh on one machine loses nothing at this rate."""
        deadline = 200
        while deadline:
            deadline -= 1
            for arrival in self._judged.take(0.1):
                said = decode(JudgementMessage, arrival.payload)
                day.judgements += 1
                ages = [vote.age_s for vote in said.votes.values()]
                if said.at_ns == self._clock.now_ns and all(age is not None and age < 0.05 for age in ages):
                    self._take_verdicts(day)
                    return
        raise AssertionError(
            f"no judgement of what was said {day.posteriors // len(OBSERVERS)} frames after the beginning"
        )

    def _take_verdicts(self, day):
        for arrival in self._decided.take(0.0):
            verdict = decode(VerdictMessage, arrival.payload)
            day.sayings.setdefault(verdict.id, []).append((verdict.label, verdict.ended_ns is not None))


def sample(hour):
    gc.collect()
    """What this process takes now."""
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    descriptors = len(list(Path("/proc/self/fd").iterdir()))
    return Sample(hour, int(status["VmRSS"].split()[0]), descriptors, threading.active_count())
