"""A capture at any moment of it."""

from itertools import pairwise

import pytest

from common.arrival import APPEARED, GONE, CaptureRecord
from common.config import Scene
from common.wire import encode
from hub.dashboard.history import CaptureTimeline, ThinnedRecords

ROOT = "laban/room"


@pytest.fixture
def timeline(make):
    scene = Scene.model_validate({"scene": "room", "observers": {"cam1": {"source": "a.npz"}}})
    at, foreign = make.NOON, make.vocabulary().model_copy(update={"hash": "foreign"})
    records = [
        CaptureRecord("token", f"{ROOT}/observer/cam1/alive", APPEARED, at),
        CaptureRecord("answer", f"{ROOT}/vocabulary", encode(make.vocabulary()), at),
        CaptureRecord("answer", f"{ROOT}/vocabulary", encode(foreign), at),
        CaptureRecord("answer", f"{ROOT}/verdict", encode(make.verdict(0, at_ns=at - 1)), at),
        CaptureRecord("put", f"{ROOT}/observer/cam1/status", encode(make.status()), at),
        CaptureRecord("put", f"{ROOT}/observer/cam1/posterior", b"not read", at),
        *(CaptureRecord("put", f"{ROOT}/judgement", encode(make.judgement(i, at + i * 10**8)), at + i * 10**8)
          for i in range(100)),
        CaptureRecord("put", f"{ROOT}/verdict", b"nonsense", at + 10**10),
        CaptureRecord("put", f"{ROOT}/verdict", encode(make.verdict(1)), at + 10**10),
        CaptureRecord("put", f"{ROOT}/verdict", encode(make.verdict(1, ended_ns=at, at_ns=at + 1)), at + 11 * 10**9),
        CaptureRecord("token", f"{ROOT}/observer/cam1/alive", GONE, at + 12 * 10**9),
    ]  # fmt: skip
    return CaptureTimeline(scene, records)


def test_each_moment_is_as_it_was(timeline, make):
    assert timeline.span_s == 12.0 and timeline.marks == [(10.0, "nthrow")]
    early = timeline.history(make.NOON + 5 * make.SECOND, with_minute=True)
    assert early.state.judgement.seq == 50 and len(early.minute) == 51
    assert [each.id for each in early.verdicts] == ["v0"] and not early.gone
    assert early.state.labels and early.state.observers[0].status.state == "running"
    middle = timeline.history(make.NOON + 10 * make.SECOND)
    assert middle.verdicts[0].ended_ns is None and not middle.minute
    late = timeline.history(timeline.ended_ns)
    assert late.verdicts[0].ended_ns == make.NOON and late.gone == {"cam1"} and late.state.silence_s > 2


def test_verdicts_between_two_moments_appear_once(timeline, make):
    steps = [make.NOON + i * 700_000_000 for i in range(20)]
    ends = [each.ended_ns for a, b in pairwise(steps) for each in timeline.verdicts_between(a, b)]
    assert ends == [None, make.NOON]


def test_a_long_capture_is_thinned_and_keeps_its_ends():
    kept = ThinnedRecords(10, 100)
    for at in range(10_000):
        kept.add(at, b"%d" % at)
    assert len(kept.at_ns) <= 101 and kept.place(-1) is None and kept.payloads[kept.place(0)] == b"0"
    assert int(kept.payloads[kept.place(10_000)]) > 9_000 and kept.at_ns == sorted(kept.at_ns)
