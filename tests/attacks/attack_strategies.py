"""What a hostile judge may send: each strategy turns what an honest judge sees into hostile messages. Pure. A strategy
is a function of a `Moment`; it returns raw MessagePack payloads, for it obeys no schema."""

from dataclasses import dataclass

import msgpack
import numpy as np

from common import SECOND_NS

LARGEST = 2**63 - 1
SURE = 0.97
JUNK = 64 * 1024
FLOOD_HZ = 20_000
HOUR_NS = 3600 * SECOND_NS


@dataclass(frozen=True)
class Moment:
    """What the hostile judge knows: the time, the number of its message, what it sees, what is really done. label: the
    index of the movement that is performed, None at rest. since_s: seconds since it began."""

    now_ns: int
    seq: int
    p: np.ndarray
    rest: float
    label: int | None
    since_s: float
    digest: str
    period_s: float

    def fields(self, **changed):
        """An honest message, with some fields changed."""
        fields = {
            "v": 2, "seq": self.seq, "session": "hostile", "captured_ns": self.now_ns, "sent_ns": self.now_ns,
            "vocabulary": {"hash": self.digest}, "p": [float(x) for x in self.p], "rest": float(self.rest),
            "frames": self.seq, "visible": {"left_hand": True},
        }  # fmt: skip
        return msgpack.packb({**fields, **changed})

    def certain(self, index):
        """As sure as can be of a movement."""
        p = np.full(len(self.p), (1 - SURE) / (len(self.p) - 1))
        p[index % len(p)] = SURE
        return p.tolist()

    @property
    def other(self):
        """A movement that is not done."""
        return 0 if self.label is None else self.label + 1


def _one(**make):
    return lambda m: [m.fields(**{name: field(m) for name, field in make.items()})]


def _wrong_from_the_first_frame(m):
    return [m.fields(p=m.certain(m.other), rest=0.02 if m.label is not None else 0.97)]


def _wrong_once_decided(m):
    is_late = m.label is not None and m.since_s > 0.6
    return [m.fields(p=m.certain(m.other), rest=0.02)] if is_late else [m.fields()]


def _second_best(m):
    second = int(np.argsort(m.p)[-2])
    return [m.fields(p=m.certain(second))]


def _flapping(m):
    return [m.fields(p=m.certain(m.seq), rest=0.02)]


def _moves_while_all_rest(m):
    return [m.fields(p=m.certain(0), rest=0.0) if m.label is None else m.fields()]


def _vetoing_prior(m):
    prior = m.certain(m.other if m.label is None else m.label)
    tiny = [1e-9 if x < 0.5 else 1 - 1e-9 * (len(prior) - 1) for x in prior]
    return [m.fields(prior=tiny)]


def _vocabularies(m):
    return [m.fields(vocabulary={"hash": m.digest if m.seq % 2 else f"{m.seq:016x}"}, p=m.certain(m.other), rest=0.0)]


def _absurd_facets(m):
    facets = {f"facet{m.seq}_{n}": [1.0] + [0.0] * 71 for n in range(32)}
    return [m.fields(facets=facets, p=m.certain(m.other), rest=0.0)]


def _many_values(m):
    return [m.fields(facets={"invented": [1 / 6000] * 6000}, p=m.certain(m.other), rest=0.0)]


def _facing(m):
    table = [[0 if k == n % 72 else 255 for k in range(72)] for n in range(len(m.p))]
    return [m.fields(facing={"surprise": table}, p=m.certain(m.other), rest=0.0)]


def _flood(m):
    count = min(round(FLOOD_HZ * m.period_s), 100)
    return [m.fields(seq=m.seq * 1000 + n, p=m.certain(m.other), rest=0.0) for n in range(count)]


def _junk(m):
    return [m.fields(), b"\xc1" * JUNK, b"", msgpack.packb({"v": 2, "p": [0.5] * 5000})]


HONEST = "honest"
STRATEGIES = {
    HONEST: lambda m: [m.fields()],
    "wrong from the first frame": _wrong_from_the_first_frame,
    "wrong once decided": _wrong_once_decided,
    "second best": _second_best,
    "rest 0": _one(rest=lambda m: 0.0),
    "rest 0, uniform": _one(rest=lambda m: 0.0, p=lambda m: [1 / len(m.p)] * len(m.p)),
    "rest 1": _one(rest=lambda m: 1.0),
    "rest inverted": _one(rest=lambda m: 1.0 - float(m.rest)),
    "rest flapping": _one(rest=lambda m: float(m.seq % 2)),
    "label flapping": _flapping,
    "moves while all rest": _moves_while_all_rest,
    "unlearned 1": _one(unlearned=lambda m: 1.0, rest=lambda m: 0.0),
    "from the future": _one(captured_ns=lambda m: m.now_ns + HOUR_NS, sent_ns=lambda m: m.now_ns + HOUR_NS,
                            p=lambda m: m.certain(m.other), rest=lambda m: 0.0),
    "time 0": _one(captured_ns=lambda m: 0, sent_ns=lambda m: 0, p=lambda m: m.certain(m.other), rest=lambda m: 0.0),
    "time frozen": _one(captured_ns=lambda m: 10**18, sent_ns=lambda m: 10**18, p=lambda m: m.certain(m.other),
                        rest=lambda m: 0.0),
    "largest numbers": _one(seq=lambda m: LARGEST, frames=lambda m: LARGEST, captured_ns=lambda m: LARGEST,
                            sent_ns=lambda m: LARGEST, p=lambda m: m.certain(m.other)),
    "absurd facets": _absurd_facets,
    "a facet of 6,000 values": _many_values,
    "facing": _facing,
    "frames": _one(frames=lambda m: LARGEST, p=lambda m: m.certain(m.other), rest=lambda m: 0.0),
    "flood": _flood,
    "junk": _junk,
    "a session for each message": _one(session=lambda m: f"s{m.seq}", p=lambda m: m.certain(m.other),
                                       rest=lambda m: 0.0),
    "vocabulary flapping": _vocabularies,
    "a prior that vetoes": _vetoing_prior,
}  # fmt: skip
"""By name; the first is none."""
ABOUT_REST = tuple(name for name in STRATEGIES if name.startswith("rest"))
"""Those that say what is done as they see it, and lie about rest."""
