"""A capture looked at from any moment."""

from itertools import pairwise

import pytest

from common.capture_file import APPEARED, GONE, CaptureRecord
from common.config import Scene
from common.wire import encode
from hub.dashboard.history import CaptureTimeline, ThinnedRecords

ROOT = "laban/room"


@pytest.fixture
def tape(said):
    scene = Scene.model_validate({"scene": "room", "observers": {"cam1": {"source": "a.npz"}}})
    at = said.NOON
    records = [
        CaptureRecord("token", f"{ROOT}/observer/cam1/alive", APPEARED, at),
        CaptureRecord("answer", f"{ROOT}/vocabulary", encode(said.vocabulary()), at),
        CaptureRecord(
            "answer", f"{ROOT}/vocabulary", encode(said.vocabulary().model_copy(update={"hash": "foreign"})), at
        ),
        CaptureRecord("answer", f"{ROOT}/verdict", encode(said.verdict(0, at_ns=at - 1)), at),
        CaptureRecord("put", f"{ROOT}/observer/cam1/status", encode(said.status()), at),
        CaptureRecord("put", f"{ROOT}/observer/cam1/posterior", b"not read", at),
        *(CaptureRecord("put", f"{ROOT}/judgement", encode(said.judgement(i, at + i * 10**8)), at + i * 10**8)
          for i in range(100)),
        CaptureRecord("put", f"{ROOT}/verdict", b"nonsense", at + 10**10),
        CaptureRecord("put", f"{ROOT}/verdict", encode(said.verdict(1)), at + 10**10),
        CaptureRecord("put", f"{ROOT}/verdict", encode(said.verdict(1, ended_ns=at, at_ns=at + 1)), at + 11 * 10**9),
        CaptureRecord("token", f"{ROOT}/observer/cam1/alive", GONE, at + 12 * 10**9),
    ]  # fmt: skip
    return CaptureTimeline(scene, records)


def test_each_moment_is_as_it_was(tape, said):
    assert tape.span_s == 12.0 and tape.marks == [(10.0, "nthrow")]
    early = tape.history(said.NOON + 5 * said.SECOND, with_minute=True)
    assert (
        early.state.judgement.seq == 50
        and [each.id for each in early.verdicts] == ["v0"]
        and len(early.minute) == 51
        and not early.gone
    )
    assert early.state.labels and early.state.observers[0].status.state == "running"
    middle = tape.history(said.NOON + 10 * said.SECOND)
    assert middle.verdicts[0].ended_ns is None and not middle.minute
    late = tape.history(tape.ended_ns)
    assert late.verdicts[0].ended_ns == said.NOON and late.gone == {"cam1"} and late.state.silence_s > 2


def test_verdicts_between_two_moments_are_told_once(tape, said):
    steps = [said.NOON + i * 700_000_000 for i in range(20)]
    told = [each.ended_ns for a, b in pairwise(steps) for each in tape.verdicts_between(a, b)]
    assert told == [None, said.NOON]


def test_a_long_capture_is_thinned_and_keeps_its_ends():
    kept = ThinnedRecords(10, 100)
    for at in range(10_000):
        kept.add(at, b"%d" % at)
    assert len(kept.at_ns) <= 101 and kept.place(-1) is None and kept.payloads[kept.place(0)] == b"0"
    assert int(kept.payloads[kept.place(10_000)]) > 9_000 and kept.at_ns == sorted(kept.at_ns)
