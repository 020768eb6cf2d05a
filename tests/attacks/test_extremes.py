"""Numbers at the end of their range, foreign labels and impossible times end no process."""

import json

import msgpack
import pytest
from attack_stage import SECOND

from common.wire import encode
from observer.foreign import LineTracks

LARGEST = 2**63 - 1
ENDLESS = "9" * 400


def forged(message, **changed):
    """A judgement or verdict with some fields changed, whatever the schema says."""
    return msgpack.packb({**msgpack.unpackb(encode(message)), **changed})


def verdict_of(fields, **changed):
    movement = {"id": "x", "began_ns": fields["at_ns"], "decided_ns": fields["at_ns"], "ended_ns": None}
    return msgpack.packb({**fields, **movement, "stage": "decided", **changed})


EXTREMES = (
    {"seq": LARGEST}, {"seq": 2**64 - 1}, {"seq": LARGEST, "epoch": LARGEST}, {"epoch": LARGEST}, {"at_ns": LARGEST},
    {"at_ns": 0, "seq": 0}, {"label": "not_a_movement"}, {"label": ""}, {"movement": {"id": "x", "began_ns": 0}},
    {"movement": {"id": "x", "began_ns": LARGEST, "label": "lunging", "decided_ns": 0}},
    {"movement": {"id": "x" * 100, "began_ns": 0, "label": "abstain", "decided_ns": LARGEST, "revises": "lunging"}},
    {"p": [1.0]}, {"certainty_bits": 1e308}, {"votes": {}}, {"votes": {"nobody": None}}, {"session": "s" * 60_000},
    {"facets": {"invented": [1 / 6000] * 6000}}, {"rule": "no such rule"}, {"fusion": "fusion"}, {"fusion": "nobody"},
)  # fmt: skip


def test_what_a_standby_service_follows_does_not_end_it(stage):
    scene, attacker = stage.scenes[0], stage.attacker()
    # It is believed only if it is a service of the scene that is there: the one that judges now.
    for fields in EXTREMES:
        stage.history.note("extreme", fields=list(fields))
        judgement = stage.witness.last(scene.scene)
        # Without a session: two processes with one id are another matter.
        for fusion in (judgement.fusion, SECOND):
            changed = {"fusion": fusion, "session": None, **fields}
            attacker.put(scene.keys.judgement, forged(judgement, **changed))
            for stage_of in ({}, {"stage": "ended", "ended_ns": LARGEST}, {"decided_ns": 0, "began_ns": LARGEST}):
                known = {**msgpack.unpackb(encode(judgement)), "label": stage.person.vocabulary.labels[0], **changed}
                attacker.put(scene.keys.verdict, verdict_of(known, **stage_of))
    stage.await_judgements(0.5)
    assert stage.alive(), stage.faults
    stage.until_all_count()


@pytest.mark.parametrize(
    "captured", [str(2**64), str(2**64 - 1), "1e400", ENDLESS, f"-{ENDLESS}", "0", "NaN", '"now"', "[]"]
)
def test_a_track_line_with_an_impossible_time_is_one_line_in_the_log(captured, caplog):
    good = json.dumps({"parts": {"left_hand": [412, 300, 0.9]}})
    bad = f'{{"captured_ns": {captured}, "parts": {{"left_hand": [412, 300, 0.9]}}}}'
    lines = iter([[(bad.encode(), 1), (good.encode(), 2)], None])
    tracks = LineTracks("tracks", clock=lambda: 3)
    frames = list(tracks.frames_of(lambda _: next(lines), type("Never", (), {"is_set": lambda self: False})()))
    assert [frame.at_ns for frame in frames] == [2] and tracks.rejected == 1
    assert len(caplog.messages) == 1 and len(caplog.messages[0]) < 500 and "\n" not in caplog.messages[0]
