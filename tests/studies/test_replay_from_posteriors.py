"""Replay from posteriors: an engine judges them in the order of their arrival, as a fusion service would."""

import pytest
from replay_stage import NOON, OBSERVERS, ROOT, STEP, key_of, labels, posterior

from common.capture_record import APPEARED, GONE, CaptureRecord
from common.messages import PosteriorMessage, StatusMessage, VocabularyHash
from common.vocabulary import Vocabulary
from common.wire import decode, encode, encode_vocabulary
from studies.replay.from_judgements import ReplayChange
from studies.replay.judging import judge_again


def test_from_posteriors_there_are_the_same_verdicts(write, unjudged):
    result = judge_again(write(unjudged), ReplayChange())
    assert (result.source, labels(result)) == ("posteriors", ["bowing", "lunging", "stretch"])
    assert labels(judge_again(write(unjudged), ReplayChange(without=("wheel",)))) == ["bowing", "abstain", "stretch"]


def test_from_posteriors_a_new_vocabulary_is_followed(write, unjudged):
    """As when the observers were taught between the second movement and the third."""
    taught = Vocabulary(("clap", "point", "wave"))
    reference, later = VocabularyHash(hash=taught.digest), NOON + 50 * STEP
    named = [CaptureRecord("put", f"{ROOT}/vocabulary", encode_vocabulary("dojo", taught), later)]
    changed = [r for r in unjudged if r.arrived_ns < later]
    for record in (r for r in unjudged if r.arrived_ns >= later):
        message = decode(PosteriorMessage, record.payload).with_fields(vocabulary=reference)
        changed.append(CaptureRecord("put", record.key, encode(message), record.arrived_ns))
    assert labels(judge_again(write([*changed, *named]), ReplayChange())) == ["bowing", "lunging", "wave"]


def test_from_posteriors_bad_messages_change_nothing_and_gone_observers_are_silent(write, unjudged):
    bad = [b"", b"\xc1", b"\x81\xa1v\x02"]
    noisy = [unjudged[0]]
    for n, record in enumerate(unjudged[1:]):
        noisy += [record, CaptureRecord("put", key_of("wheel"), bad[n % len(bad)], record.arrived_ns)]
        stolen = encode(posterior("door", 10_000 + n, record.arrived_ns, "stretch"))
        noisy.append(CaptureRecord("put", key_of("wheel"), stolen, record.arrived_ns))
    quiet = judge_again(write(unjudged), ReplayChange())
    loud = judge_again(write(noisy), ReplayChange())
    assert [row.last_replayed.label for row in loud.rows] == [row.last_replayed.label for row in quiet.rows]
    assert [row.began_ns for row in loud.rows] == [row.began_ns for row in quiet.rows]
    # Two observers end as the last movement begins: one is left, below the quorum.
    last = quiet.rows[-1].began_ns
    gone = [CaptureRecord("token", key_of(o, "alive"), APPEARED, NOON) for o in OBSERVERS]
    gone += [r for r in unjudged if r.arrived_ns <= last or "/door/" in r.key]
    at = next(n for n, r in enumerate(gone) if r.arrived_ns > last)
    gone[at:at] = [CaptureRecord("token", key_of(o, "alive"), GONE, last) for o in ("corner", "wheel")]
    assert labels(judge_again(write(gone), ReplayChange())) == ["bowing", "lunging", "abstain"]


def test_from_posteriors_time_passes_in_silence(write, unjudged):
    open_end = [r for r in unjudged if r.arrived_ns <= NOON + 18 * STEP]
    (row,) = judge_again(write(open_end), ReplayChange()).rows
    assert row.last_replayed.ended_ns is None
    later = CaptureRecord("put", f"{ROOT}/fusion/fusion/status", b"", NOON + 60 * STEP)
    (row,) = judge_again(write([*open_end, later]), ReplayChange()).rows
    # Past drop_s all observers are silent, which counts as rest.
    assert row.last_replayed.ended_ns == pytest.approx(NOON + 18 * STEP + 2 * 10**9, abs=2 * STEP)


def test_from_posteriors_a_wrong_clock_is_corrected_by_its_status(write, unjudged):
    hour_ns, shifted = 3600 * 10**9, []
    for record in unjudged:
        if "/wheel/" in record.key:
            at_ns, message = record.arrived_ns, decode(PosteriorMessage, record.payload)
            status = StatusMessage(scene="dojo", id="wheel", state="running", at_ns=at_ns - hour_ns)
            times = {"captured_ns": message.captured_ns - hour_ns, "sent_ns": message.sent_ns - hour_ns}
            late = encode(message.with_fields(**times))
            shifted.append(CaptureRecord("put", key_of("wheel", "status"), encode(status), at_ns))
            record = CaptureRecord(record.kind, record.key, late, at_ns)
        shifted.append(record)
    assert labels(judge_again(write(shifted), ReplayChange())) == ["bowing", "lunging", "stretch"]
