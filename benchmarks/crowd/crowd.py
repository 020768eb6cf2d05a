"""SIMULATED observers on a real mesh: they publish posteriors and receive judgements and verdicts."""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher

import msgpack
import numpy as np

from common.inbox import Inbox
from common.keys import SceneKeys
from common.link import Link, Publisher
from common.messages import PosteriorMessage, VocabularyReference
from common.vocabulary import Vocabulary
from common.wire import encode

NAMES = Vocabulary(tuple(f"movement_{n}" for n in range(20)), "crowd")
REFERENCE = VocabularyReference(name=NAMES.name, hash=NAMES.digest)
JUDGES = 4
PERIOD_S, MOVING_S = 4.0, 2.0
SEQ, CAPTURED, SENT = 0x7E5E0001, 0x7E5E00020A0B0C0D, 0x7E5E00030A0B0C0D
"""Places in the bytes where the numbers of each message are put in; no float of a belief has these bytes."""


@dataclass(frozen=True, slots=True)
class Movement:
    """What is done in a scene: its number from the start, its label, and whether he moves now."""

    number: int
    label: str
    moving: bool


def movement(scene: int, scenes: int, elapsed_s: float) -> Movement:
    """What is done in scene number `scene` of `scenes` at `elapsed_s`; he begins each period at rest."""
    shifted = elapsed_s / PERIOD_S + scene / scenes
    number = int(shifted)
    moving = (shifted - number) * PERIOD_S >= PERIOD_S - MOVING_S
    return Movement(number, NAMES.labels[(scene * 7 + number * 3) % NAMES.size], moving)


class Saying:
    """A message of which only numbers and times change: made once, then filled in."""

    def __init__(self, scene: str, observer: str, p: list[float], rest: float) -> None:
        told = PosteriorMessage(
            scene=scene,
            observer=observer,
            seq=SEQ,
            session="crowd",
            captured_ns=CAPTURED,
            sent_ns=SENT,
            vocabulary=REFERENCE,
            p=p,
            rest=rest,
            frames=100,
            visible={"left_hand": True, "right_hand": True, "head": True},
        )
        whole = encode(told)
        places = [whole.index(number.to_bytes(size)) for number, size in ((SEQ, 4), (CAPTURED, 8), (SENT, 8))]
        seq, captured, sent = places
        self._parts = whole[:seq], whole[seq + 4 : captured], whole[captured + 8 : sent], whole[sent + 8 :]

    def at(self, seq: int, captured_ns: int) -> bytes:
        """The message number `seq` of this session, captured and sent at that time."""
        time_bytes = captured_ns.to_bytes(8)
        one, two, three, four = self._parts
        # As wide as its place: numbers below 2**16 would be shorter in MessagePack.
        return one + (seq + 0x10000).to_bytes(4) + two + time_bytes + three + time_bytes + four


def belief(label: str | None, judge: int) -> tuple[list[float], float]:
    """(p, rest) of judge number `judge` when `label` is done; None: nothing yet."""
    p = np.full(NAMES.size, 1.0)
    if label is not None:
        p[NAMES.index(label)] = 400.0 / (1 + judge)
    return (p / p.sum()).tolist(), 0.95 if label is None else 0.03


SLOTS = 8
"""So many times per frame interval a share of the observers speaks: cameras are not in step."""


def scene_name(number: int) -> str:
    """Scenes of a crowd are numbered."""
    return f"home{number:04d}"


@dataclass(slots=True)
class Account:
    """What came of it. ages_s: of judgements when they came, since the newest frame that they rest on.

    done: by scene, the labels of the movements that are over; ended: those of the verdicts whose end was said; told:
    how often that was, by the verdict's id. late_s: how far the crowd itself was behind at most.
    """

    put: int = 0
    judgements: int = 0
    ages_s: list[float] = field(default_factory=list)
    done: dict[str, list[str]] = field(default_factory=dict)
    ended: dict[str, list[str]] = field(default_factory=dict)
    told: Counter[str] = field(default_factory=Counter)
    late_s: float = 0.0

    @property
    def movements(self) -> int:
        """How many are over."""
        return sum(map(len, self.done.values()))

    @property
    def right(self) -> int:
        """Verdicts with the label of the movement that is over, in order: each counts once."""
        return sum(_in_order(done, self.ended.get(scene, [])) for scene, done in self.done.items())

    @property
    def doubled(self) -> int:
        """Ends that were said more often than once."""
        return sum(count - 1 for count in self.told.values())


class Crowd:
    """All observers of `scenes` scenes."""

    def __init__(self, link: Link, scenes: int, rate_hz: float) -> None:
        self._scenes, self._rate_hz = scenes, rate_hz
        keys = [SceneKeys(scene_name(n)) for n in range(scenes)]
        self._voices: list[list[Publisher]] = [
            [link.publisher(key.posterior(f"cam{judge}")) for judge in range(JUDGES)] for key in keys
        ]
        for key in keys:
            for judge in range(JUDGES):
                link.announce(key.observer_alive(f"cam{judge}"))
        self._sayings: list[tuple[Movement, list[Saying]] | None] = [None] * scenes
        self._seq, self._still, self._spoken_s = 0, False, 0.0
        # Polled: a thread that waits for its turn beside this busy one would take what comes for older than it is.
        self._ears = link.sub_session(polled=True)
        self._box: Inbox = self._ears.inbox("laban/*/judgement", limit=1_000_000)
        self._verdicts: Inbox = self._ears.inbox("laban/*/verdict", limit=1_000_000)
        self.account = Account()

    def ready(self, timeout_s: float) -> bool:
        """Whether somebody listens to every observer."""
        return all(voice.wait_for_subscriber(timeout_s) for voices in self._voices for voice in voices)

    def speak(self, seconds: float, each_second: Callable[[], None] = lambda: None) -> None:
        """Play for so long."""
        slot_s = 1 / self._rate_hz / SLOTS
        begun_s = due_s = told_s = time.monotonic()
        end_s = due_s + seconds
        while due_s < end_s:
            self._seq += 1
            for slot in range(SLOTS):
                now_s = time.monotonic()
                for scene in range(slot, self._scenes, SLOTS):
                    self._say(scene, self._spoken_s + now_s - begun_s)
                self._listen()
                due_s += slot_s
                left_s = due_s - time.monotonic()
                self.account.late_s = max(self.account.late_s, -left_s)
                if left_s > 0:
                    time.sleep(left_s)
            if due_s - told_s >= 1:
                told_s = due_s
                each_second()
        self._spoken_s += seconds

    def settle(self, seconds: float) -> None:
        """Everybody comes to rest, until the last verdicts have come."""
        self._still = True
        self.speak(seconds)

    def _say(self, scene: int, elapsed_s: float) -> None:
        now, before = movement(scene, self._scenes, elapsed_s), self._sayings[scene]
        if self._still and (before is None or before[0] != now):
            # Who moves moves on to his end; nobody begins.
            now = replace(now, moving=False)
        if before is None or before[0] != now:
            name = scene_name(scene)
            if before is not None and before[0].moving:
                self.account.done.setdefault(name, []).append(before[0].label)
            self._sayings[scene] = before = now, _sayings(name, now)
        for voice, saying in zip(self._voices[scene], before[1], strict=True):
            voice.put(saying.at(self._seq, time.time_ns()))
        self.account.put += JUDGES

    def _listen(self) -> None:
        self._ears.poll()
        for arrival in self._box.take(0):
            said = msgpack.unpackb(arrival.payload)
            ages = [vote["age_s"] for vote in said["votes"].values() if vote["age_s"] is not None]
            self.account.judgements += 1
            if ages:
                self.account.ages_s.append((arrival.arrived_ns - said["at_ns"]) / 1e9 + min(ages))
        for arrival in self._verdicts.take(0):
            said = msgpack.unpackb(arrival.payload)
            if said["ended_ns"] is not None:
                self.account.told[said["id"]] += 1
                self.account.ended.setdefault(said["scene"], []).append(said["label"])


def _sayings(scene: str, now: Movement) -> list[Saying]:
    told = [belief(now.label if now.moving else None, judge) for judge in range(JUDGES)]
    return [Saying(scene, f"cam{judge}", p, rest) for judge, (p, rest) in enumerate(told)]


def _in_order(done: list[str], ended: list[str]) -> int:
    """How many of `done` come in `ended` in their order: the longest common subsequence."""
    matcher = SequenceMatcher(None, done, ended, autojunk=False)
    return sum(block.size for block in matcher.get_matching_blocks())
