"""Mutated messages: flipped bits, maps with spoiled fields, and noise. Everything depends on the seed alone, so that a
failure can be reproduced."""

import copy
import math
import random

import msgpack

from common.messages import (
    Agreement,
    Facing,
    JudgementMessage,
    OngoingMovement,
    PosteriorMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
    VocabularyReference,
    Vote,
)
from common.picture_message import PictureMessage
from common.teaching_messages import EarlierTakes, LearnedReport, TakeDoubt, TakeReport, TeachReply, TeachRequest
from common.vocabulary import Vocabulary
from common.wire import encode

SCENE, OBSERVERS = "dojo", ("cam1", "cam2", "cam3")
NAMES = Vocabulary(("bowing", "lunging", "byebye", "stretch"))
REFERENCE = VocabularyReference(name=NAMES.name, hash=NAMES.digest)
NOON_NS = 1_700_000_000_000_000_000
KEY = f"laban/{SCENE}/observer/{{}}/posterior"
KINDS = (
    *(PosteriorMessage, JudgementMessage, VerdictMessage, StatusMessage, VocabularyMessage, PictureMessage),
    *(TeachRequest, TeachReply),
)
NASTY = (
    *(None, True, False, 0, -1, 1, 2**31, 2**63 - 1, 2**64 - 1, -(2**63)),
    *(0.0, -0.0, 1e-320, 1e308, -1e308, math.nan, math.inf, -math.inf),
    *("", "x", "cam2", "CAM1", "../..", "a" * 65, "é\u202e\0", "NaN", b"", b"\xff\xfe"),
    *([], [0.5, 0.5], [1.0, 0.0, 0.0, 0.0], [math.nan] * 4, [2.0, -1.0, 0.0, 0.0], [0.25] * 5, ["a"] * 4),
    *({}, {"": None}, {"name": 1, "hash": 2}, {"cam1": {}}, [[[[]]]]),
)
"""Values that are wrong in some or all fields."""


def posterior(rng, observer="cam1", seq=0, captured_ns=NOON_NS, session="good"):
    """A good posterior."""
    mass = [rng.random() ** 3 + 1e-3 for _ in NAMES.labels]
    return PosteriorMessage(
        v=1, scene=SCENE, observer=observer, seq=seq, session=session, captured_ns=captured_ns,
        sent_ns=captured_ns + 1_000_000, vocabulary=REFERENCE, p=[m / sum(mass) for m in mass], rest=rng.random(),
        frames=seq + 1,
        visible={"left_hand": rng.random() < 0.9, "head": True},
        unlearned=rng.choice((None, rng.random())),
        facing=rng.choice((None, Facing(surprise=[[rng.randrange(60) for _ in range(4)] for _ in NAMES.labels]))),
        facets={"effort_time": [0.25, 0.75], "own": [0.5, 0.25, 0.25]} if rng.random() < 0.5 else None,
    )  # fmt: skip


def good_messages(rng):
    """One good message of each kind."""
    p = [0.7, 0.1, 0.1, 0.1]
    vote = Vote(
        label="bowing", entropy=1.2, weight=0.5, age_s=0.1, state="counted", p=p, rest=0.2, skew_s=0.01, unlearned=0.1,
        facing={"surprise": [[0, 9]] * 4}, facets={"own": [1.0]}, reliability=0.5, doubles={"cam2": 0.5},
    )  # fmt: skip
    movement = {"id": "dojo-1", "began_ns": NOON_NS, "decided_ns": NOON_NS}
    fields = {
        "scene": SCENE, "fusion": "fusion", "seq": 3, "at_ns": NOON_NS, "vocabulary": REFERENCE, "p": p,
        "label": "bowing", "certainty_bits": 1.3, "rule": "log", "votes": dict.fromkeys(OBSERVERS, vote),
        "agreement": Agreement(k=2, n=3), "unlearned": 0.1,
        "movement": OngoingMovement(**movement, label="bowing", revises="byebye"),
        "why": "bowing 79 % of the 80 % needed", "facets": {"facing": [0.5, 0.5]}, "facing_deg": 90.0,
    }  # fmt: skip
    contributions = {"cam1": {"nats": 1.0, "stands": True}}
    return (
        posterior(rng),
        JudgementMessage(**fields),
        VerdictMessage(
            **fields, **movement, contributions=contributions, ended_ns=NOON_NS + 1, stage="ended", revises="byebye"
        ),
        StatusMessage(
            scene=SCENE, id="cam1", state="running", rate_hz=15.0, last_frame_ns=NOON_NS, at_ns=NOON_NS,
            leans_on={"hash": NAMES.digest, "regions": ["right arm", "trunk"], "shares": [[81, 12]] * NAMES.size},
        ),
        VocabularyMessage(scene=SCENE, name=NAMES.name, hash=NAMES.digest, labels=list(NAMES.labels)),
        PictureMessage(captured_ns=NOON_NS, width=320, height=240, jpeg=b"\xff\xd8" + bytes(200)),
        TeachRequest(command="begin", teacher="t", labels=list(NAMES.labels), label="bowing", take=2, person="anna"),
        TeachReply(
            state="learned", take=TakeReport(label="bowing", take=2, state="kept"), takes={"bowing": [1, 2]},
            other_s=2.0, labels=list(NAMES.labels), persons={"anna": {"bowing": 2, "": 1}},
            learned=LearnedReport(labels=list(NAMES.labels), results={"bowing": {"bowing": 2}}),
            doubts=[TakeDoubt(label="bowing", take=1, like="lunging")], earlier=[EarlierTakes(id="t", at_ns=NOON_NS)],
        ),
    )  # fmt: skip


class Mutator:
    """Makes mutated messages from good ones."""

    def __init__(self, seed):
        self.rng = random.Random(seed)  # noqa: S311 - reproducible, not secret
        self._good = [encode(message) for message in good_messages(self.rng)]
        self._mutations = (self._spoil, self._spoil, self._flip, self._cut, self._splice, self._noise)

    def next(self, good=b""):
        """The bytes of a mutated message; of `good` if it is given."""
        return self.rng.choice(self._mutations)(good or self.rng.choice(self._good))

    def _spoil(self, good):
        """Spoil one to three fields: wrong value, omitted, or unknown."""
        fields, rng = msgpack.unpackb(good), self.rng
        for _ in range(rng.randint(1, 3)):
            place, name = fields, rng.choice(sorted(fields) or ["v"])
            inner = place.get(name)
            if isinstance(inner, dict) and inner and rng.random() < 0.5:
                place, name = inner, rng.choice(sorted(inner))
            self._spoil_field(place, name)
        return msgpack.packb(fields)

    def _spoil_field(self, place, name):
        rng, value = self.rng, place.get(name)
        chance = rng.random()
        if chance < 0.15:
            place.pop(name, None)
        elif chance < 0.25:
            place["".join(rng.choices("abcvp_", k=3))] = self._nasty()
        elif chance < 0.5 and isinstance(value, list) and value:
            place[name] = [*value[:-1], self._nasty()] if rng.random() < 0.7 else value * rng.choice((0, 2, 300))
        elif chance < 0.6 and type(value) is int:
            place[name] = max(min(value + rng.choice((-1, 1)) * 10 ** rng.randint(0, 18), 2**64 - 1), -(2**63))
        else:
            place[name] = self._nasty()

    def _nasty(self):
        # A copy, because a second field inside it may be spoiled.
        return copy.deepcopy(self.rng.choice(NASTY))

    def _flip(self, good):
        """Flip some bits."""
        flipped = bytearray(good)
        for _ in range(self.rng.choice((1, 1, 2, 8))):
            flipped[self.rng.randrange(len(flipped))] ^= 1 << self.rng.randrange(8)
        return bytes(flipped)

    def _cut(self, good):
        """Remove, double or move a piece."""
        a, b = sorted(self.rng.choices(range(len(good) + 1), k=2))
        return self.rng.choice((good[:a], good[a:], good[:a] + good[b:], good[:b] + good[a:], good + good[a:b]))

    def _splice(self, good):
        """Join the beginning of one message and the end of another."""
        other = self.rng.choice(self._good)
        return good[: self.rng.randrange(len(good))] + other[self.rng.randrange(len(other)) :]

    def _noise(self, good):
        """Random bytes, some after a header that claims more than there is."""
        size = self.rng.choice((0, 1, 5, 60, 400))
        head = self.rng.choice(
            (b"", b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff", b"\x8d")
        )
        deep = b"\x91" * self.rng.choice((0, 0, 0, 600, 3000))
        return head + deep + self.rng.randbytes(size)
