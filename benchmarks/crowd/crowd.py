"""SIMULATED observers on a real mesh: they publish posteriors and receive judgements and verdicts.

In each scene a person rests and moves by turns: PERIOD_S from one movement to the next, of which MOVING_S are movement.
The scenes are shifted against each other. The observers agree on the movement, each a little less certain than the one
before. Nobody moves, but the messages are real.
"""

import time
from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher
from itertools import pairwise

import msgpack
import numpy as np

from common import SECOND_NS
from common.facets import SHAPE
from common.keys import SceneKeys
from common.link import Link, Publisher
from common.messages import PosteriorMessage, VocabularyHash
from common.vocabulary import ABSTAIN, Vocabulary
from common.wire import encode

NAMES = Vocabulary(tuple(f"movement_{n}" for n in range(20)), "crowd")
OBSERVERS = 4
"""In each scene."""
PERIOD_S, MOVING_S = 4.0, 2.0
SHAPES = [0.1, 0.2, 0.7], [0.05, 0.9, 0.05], [0.6, 0.35, 0.05]
SLOTS = 8
"""Parts of a frame interval; a share of the observers publishes in each, because cameras are not synchronised."""
SEQ, CAPTURED, SENT = 0x7E5E0001, 0x7E5E00020A0B0C0D, 0x7E5E00030A0B0C0D
"""Placeholders in the bytes of a message for its number and times; no probability has these bytes."""


def scene_name(number: int) -> str:
    """The name of a scene of the crowd."""
    return f"home{number:04d}"


@dataclass(frozen=True, slots=True)
class SimulatedMovement:
    """The movement of a scene: its number from the start, its label, and whether the person moves now."""

    number: int
    label: str
    moving: bool


def movement_at(scene: int, scenes: int, elapsed_s: float) -> SimulatedMovement:
    """The movement in scene number `scene` of `scenes` at `elapsed_s`; each period begins with rest."""
    shifted = elapsed_s / PERIOD_S + scene / scenes
    number = int(shifted)
    moving = (shifted - number) * PERIOD_S >= PERIOD_S - MOVING_S
    return SimulatedMovement(number, NAMES.labels[(scene * 7 + number * 3) % NAMES.size], moving)


class PosteriorTemplate:
    """An encoded posterior in which only number and times change. label: the movement, None for rest.

    It has what observers send by default: `unlearned` and Shape.
    """

    def __init__(self, observer: int, label: str | None) -> None:
        p = np.full(NAMES.size, 1.0)
        if label is not None:
            p[NAMES.index(label)] = 400.0 / (1 + observer)
        message = PosteriorMessage(
            v=2,
            seq=SEQ,
            session="crowd",
            captured_ns=CAPTURED,
            sent_ns=SENT,
            vocabulary=VocabularyHash(hash=NAMES.digest),
            p=(p / p.sum()).tolist(),
            rest=0.95 if label is None else 0.03,
            unlearned=0.02,
            frames=100,
            facets=dict(zip(SHAPE, SHAPES, strict=True)),
        )
        whole = encode(message)
        seq, captured, sent = (whole.index(n.to_bytes(size)) for n, size in ((SEQ, 4), (CAPTURED, 8), (SENT, 8)))
        self._parts = whole[:seq], whole[seq + 4 : captured], whole[captured + 8 : sent], whole[sent + 8 :]

    def at(self, seq: int, captured_ns: int) -> bytes:
        """Message number `seq`, captured and sent at that time."""
        time_bytes = captured_ns.to_bytes(8)
        one, two, three, four = self._parts
        # As wide as its placeholder: MessagePack encodes numbers below 2**16 in fewer bytes.
        return one + (seq + 0x10000).to_bytes(4) + two + time_bytes + three + time_bytes + four


def templates(label: str | None) -> list[PosteriorTemplate]:
    """The messages of a scene's observers while `label` is performed, or at rest."""
    return [PosteriorTemplate(observer, label) for observer in range(OBSERVERS)]


@dataclass(slots=True)
class CrowdCounts:
    """Counts of a run. ages_s: age of the newest frame in each judgement when it arrives.

    done: by scene, the labels of the movements that are over; ended: those of the ended verdicts; endings: by verdict
    id, the labels with which it ended. judges: by scene, who judged last. late_s: the crowd's own greatest delay.
    """

    put: int = 0
    judgements: int = 0
    ages_s: list[float] = field(default_factory=list)
    done: dict[str, list[str]] = field(default_factory=dict)
    ended: dict[str, list[str]] = field(default_factory=dict)
    endings: dict[str, list[str]] = field(default_factory=dict)
    judges: dict[str, str] = field(default_factory=dict)
    late_s: float = 0.0

    @property
    def movements(self) -> int:
        """Movements that are over."""
        return sum(map(len, self.done.values()))

    @property
    def right(self) -> int:
        """Verdicts with the label of a movement, in order, each counted once: the longest common subsequence."""
        return sum(_common(done, self.ended.get(scene, [])) for scene, done in self.done.items())

    @property
    def doubled(self) -> int:
        """Verdicts with two ends, and movements with two verdicts: neighbours have different labels."""
        neighbours = (pairwise(labels) for labels in self.ended.values())
        under_two_ids = sum(a == b != ABSTAIN for pairs in neighbours for a, b in pairs)
        return under_two_ids + sum(len(labels) - 1 for labels in self.endings.values())

    def record_end(self, scene: str, verdict_id: str, label: str) -> None:
        """Count the end of a verdict; one that is sent again is ignored, as hubs do."""
        labels = self.endings.setdefault(verdict_id, [])
        if label not in labels:
            labels.append(label)
            self.ended.setdefault(scene, []).append(label)


class Crowd:
    """All observers of `scenes` scenes."""

    def __init__(self, link: Link, scenes: int, rate_hz: float) -> None:
        self._scenes, self.rate_hz = scenes, rate_hz
        keys = [SceneKeys(scene_name(n)) for n in range(scenes)]
        ids = [f"cam{observer}" for observer in range(OBSERVERS)]
        self._publishers: list[list[Publisher]] = [[link.publisher(key.posterior(i)) for i in ids] for key in keys]
        for key in keys:
            for i in ids:
                link.announce(key.observer_alive(i))
        self._current: list[tuple[SimulatedMovement, list[PosteriorTemplate]] | None] = [None] * scenes
        self._seq, self._settling, self._published_s = 0, False, 0.0
        # Polled: a thread that competes with this busy one would make messages look older than they are.
        self._session = link.sub_session(polled=True)
        self._judgements = self._session.inbox("laban/*/judgement", limit=1_000_000)
        self._verdicts = self._session.inbox("laban/*/verdict", limit=1_000_000)
        self.counts = CrowdCounts()

    def ready(self, timeout_s: float) -> bool:
        """Whether every observer has a subscriber."""
        return all(own.wait_for_subscriber(timeout_s) for publishers in self._publishers for own in publishers)

    def publish(self, seconds: float) -> None:
        """Publish and receive for that long."""
        slot_s = 1 / self.rate_hz / SLOTS
        begun_s = due_s = time.monotonic()
        end_s = due_s + seconds
        while due_s < end_s:
            self._seq += 1
            for slot in range(SLOTS):
                now_s = time.monotonic()
                for scene in range(slot, self._scenes, SLOTS):
                    self._publish(scene, self._published_s + now_s - begun_s)
                self._receive()
                due_s += slot_s
                left_s = due_s - time.monotonic()
                self.counts.late_s = max(self.counts.late_s, -left_s)
                if left_s > 0:
                    time.sleep(left_s)
        self._published_s += seconds

    def settle(self, seconds: float) -> None:
        """Let all movements end, and receive the last verdicts."""
        self._settling = True
        self.publish(seconds)

    def _publish(self, scene: int, elapsed_s: float) -> None:
        now, current = movement_at(scene, self._scenes, elapsed_s), self._current[scene]
        if self._settling and (current is None or current[0] != now):
            # A movement that goes on ends; none begins.
            now = replace(now, moving=False)
        if current is None or current[0] != now:
            name = scene_name(scene)
            if current is not None and current[0].moving:
                self.counts.done.setdefault(name, []).append(current[0].label)
            self._current[scene] = current = now, templates(now.label if now.moving else None)
        for publisher, template in zip(self._publishers[scene], current[1], strict=True):
            publisher.put(template.at(self._seq, time.time_ns()))
        self.counts.put += OBSERVERS

    def _receive(self) -> None:
        self._session.poll()
        for arrival in self._judgements.take(0):
            judgement = msgpack.unpackb(arrival.payload)
            ages = [vote["age_s"] for vote in judgement["votes"].values() if vote["age_s"] is not None]
            self.counts.judgements += 1
            self.counts.judges[judgement["scene"]] = judgement["fusion"]
            if ages:
                self.counts.ages_s.append((arrival.arrived_ns - judgement["at_ns"]) / SECOND_NS + min(ages))
        for arrival in self._verdicts.take(0):
            verdict = msgpack.unpackb(arrival.payload)
            if verdict["ended_ns"] is not None:
                self.counts.record_end(verdict["scene"], verdict["id"], verdict["label"])


def _common(done: list[str], ended: list[str]) -> int:
    matcher = SequenceMatcher(None, done, ended, autojunk=False)
    return sum(block.size for block in matcher.get_matching_blocks())
