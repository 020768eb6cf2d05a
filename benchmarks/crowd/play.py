"""SIMULATED observers: what each of many says at a time, as bytes. Pure; nobody moves here, but the messages are real.

In each scene somebody rests, then moves: `PERIOD_S` from one movement to the next, of which he moves `MOVING_S`. The
scenes are shifted against each other. The judges are sure of the movement, each a little less than the one before.
"""

from dataclasses import dataclass

import numpy as np

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
