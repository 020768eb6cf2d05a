"""Random and mutated messages raise only BadMessage, change no judgement, and fill no memory. LABANMESH_FUZZ is the
number of messages (`make fuzz`: a million), LABANMESH_FUZZ_SEED the seed."""

import logging
import math
import os
import resource

import msgpack
from fuzz_mutator import KEY, KINDS, NAMES, NOON_NS, OBSERVERS, SCENE, Mutator, good_messages, posterior
from hypothesis import given
from hypothesis import strategies as st
from message_fields_of import field_names

from common.config import FusionConfig
from common.inbox import Arrival
from common.wire import BadMessage, decode, encode
from fusion.engine.engine import FusionEngine
from fusion.ingest import PosteriorIngest

MESSAGES = int(os.environ.get("LABANMESH_FUZZ", "10000"))
SEED = int(os.environ.get("LABANMESH_FUZZ_SEED", "0"))
OTHER_IDS = ("cam9", "Cam1", "", "a" * 65, "é", "fusion")
FRAME_NS = 33_333_333
STEP_EVERY = 40
GROWTH_LIMIT_KB = 30_000
"""Peak memory may grow by this much during a test: caches of pydantic and numpy, not messages."""


def test_whatever_is_decoded_is_a_message_or_a_bad_message():
    mutator, good, before_kb = Mutator(SEED), 0, peak_kb()
    for n in range(MESSAGES):
        payload = mutator.next()
        for kind in (KINDS[n % len(KINDS)], KINDS[mutator.rng.randrange(len(KINDS))]):
            try:
                message = decode(kind, payload)
            except BadMessage as bad:
                assert bad.detail is not None
            else:
                good += 1
                # An accepted message can be encoded again.
                encode(message)
    assert 0 < good < MESSAGES, "mutations that spoil all messages, or none, test little"
    assert peak_kb() - before_kb < GROWTH_LIMIT_KB


def new_engine(kind=FusionEngine, *first):
    return kind(*first, SCENE, list(OBSERVERS), NAMES, FusionConfig(quorum=2))


class LeadingEngine(FusionEngine):
    """Passes each message that it accepts to another engine."""

    def __init__(self, follower, *arguments):
        super().__init__(*arguments)
        self._follower = follower
        self.accepted = 0

    def receive(self, observer, message, now_ns):
        reason = super().receive(observer, message, now_ns)
        if reason is None:
            self.accepted += 1
            assert self._follower.receive(observer, message, now_ns) is None
        return reason


def take(ingest, engine, key, payload, now_ns):
    """One message that arrives now."""
    ingest.pass_on(ingest.read([Arrival(key, payload, now_ns)], now_ns), engine, now_ns)


def test_bad_messages_change_no_judgement(caplog):
    caplog.set_level(logging.CRITICAL, "labanmesh.fusion")
    quiet, now_ns = new_engine(), NOON_NS
    noisy = new_engine(LeadingEngine, quiet)
    ingest = PosteriorIngest(noisy)
    mutator, before_kb, compared = Mutator(SEED + 1), peak_kb(), 0
    for n in range(MESSAGES):
        observer = OBSERVERS[n % len(OBSERVERS)]
        # Observers restart now and then, so that no spoiled session or number silences them for long.
        good = encode(posterior(mutator.rng, observer, n, now_ns, session=f"s{n // 60}"))
        where = observer if n % 7 else OTHER_IDS[n // 7 % len(OTHER_IDS)]
        take(ingest, noisy, KEY.format(where), mutator.next(good), now_ns)
        if n % 3 == 0:
            take(ingest, noisy, KEY.format(observer), good, now_ns)
        now_ns += FRAME_NS // len(OBSERVERS)
        if n % STEP_EVERY == 0:
            one, other = noisy.step(now_ns), quiet.step(now_ns)
            assert belief(one.judgement) == belief(other.judgement)
            assert [v.id for v in one.verdicts] == [v.id for v in other.verdicts]
            assert all(map(math.isfinite, one.judgement.p))
            compared += 1
    rejected = sum(sum(each.rejected.values()) for each in ingest.statistics(OBSERVERS).values())
    assert rejected > 0.5 * MESSAGES and noisy.accepted > 0.2 * MESSAGES and compared
    assert len(ingest.statistics(OBSERVERS)) < 300
    assert peak_kb() - before_kb < GROWTH_LIMIT_KB


def test_an_observer_counts_again_after_forged_messages_in_its_name():
    engine, now_ns, mutator = new_engine(), NOON_NS, Mutator(SEED + 2)
    ingest = PosteriorIngest(engine)
    for n in range(MESSAGES // 10):
        now_ns += FRAME_NS
        good = encode(posterior(mutator.rng, "cam1", n, now_ns))
        take(ingest, engine, KEY.format("cam1"), mutator.next(good), now_ns)
    for later in range(150):  # five seconds without forged messages
        now_ns += FRAME_NS
        good = encode(posterior(mutator.rng, "cam1", n + 1 + later, now_ns))
        take(ingest, engine, KEY.format("cam1"), good, now_ns)
    assert engine.step(now_ns).judgement.votes["cam1"].state in ("counted", "stale")


def belief(judgement):
    """The content of a judgement without the reasons why an observer does not count."""
    votes = {name: (vote.label, vote.weight, vote.age_s, vote.p) for name, vote in judgement.votes.items()}
    return judgement.p, judgement.label, judgement.certainty_bits, votes, judgement.agreement


TREES = st.recursive(
    st.sampled_from([None, True, False, b""]) | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=6) | st.dictionaries(st.text(max_size=8) | st.integers(0, 9), inner, max_size=6)
    ),
    max_leaves=12,
)
FIELDS = sorted({name for kind in KINDS for name in field_names(kind)})


@given(st.sampled_from(KINDS), st.dictionaries(st.sampled_from(FIELDS), TREES, max_size=6), st.booleans())
def test_any_tree_in_any_field(kind, fields, whole):
    base = encode(good_messages(Mutator(0).rng)[KINDS.index(kind)]) if whole else msgpack.packb({"v": 1})
    try:
        message = decode(kind, msgpack.packb({**msgpack.unpackb(base), **fields}))
    except BadMessage:
        return
    encode(message)


def peak_kb():
    """Peak memory of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
