"""Replay: a capture judged again gives the same verdicts, bit for bit, and other ones with a change."""

import json
import re
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from processes import SOON_S
from replay_stage import (
    NAMES,
    NOON,
    OBSERVERS,
    PLAY,
    ROOT,
    STEP,
    a_scene,
    labels,
    new_engine,
    posterior,
    recorded,
    steps,
)

import labanmesh
from common.arrival import APPEARED, GONE, CaptureRecord
from common.errors import BadInput, LabanmeshError
from common.message_types import MovementTimes
from common.messages import Facing, JudgementMessage, VerdictMessage
from common.posterior import ObservedScore
from common.wire import decode, encode, encode_vocabulary
from fusion.engine.verdicts import CONTESTED_REST
from studies.fusion_engine import FusionEngine, step
from studies.replay.comparison import VerdictRecord, as_json, as_text, compare_verdicts
from studies.replay.from_judgements import Gap, ReplayChange
from studies.replay.judging import judge_again

HOUSE = Path(__file__).parents[2]


def judgements(records):
    return [n for n, record in enumerate(records) if record.key == f"{ROOT}/judgement"]


def test_the_same_verdicts_bit_for_bit(write, records):
    result = judge_again(write(records), ReplayChange())
    assert labels(result, "last_recorded") == ["bowing", "lunging", "stretch"]
    assert [row.likeness for row in result.rows] == ["bit for bit"] * 3
    assert [len(row.recorded) for row in result.rows] == [2, 2, 2]
    assert result.same == result.judgements == len(steps()) and result.missing == 0
    assert result.faithful


def test_verdicts_that_are_sent_again_count_once(write, records):
    """A service repeats what may have been lost while its router was away."""
    again = [n for n, record in enumerate(records) if record.key == f"{ROOT}/verdict"][3:5]
    later = next(n for n in judgements(records) if n > again[-1]) + 1
    repeated = [*records[:later], *(records[n] for n in again), *records[later:]]
    result = judge_again(write(repeated), ReplayChange())
    assert [(row.likeness, len(row.recorded)) for row in result.rows] == [("bit for bit", 2)] * 3 and result.faithful


def test_short_judgements_are_judged_again_from_the_full_votes_beside_them(write):
    records = recorded(a_scene(), steps(), short=True)
    result = judge_again(write(records), ReplayChange())
    assert result.missing == 0 and result.faithful
    assert result.same == result.judgements == len(judgements(records))
    # A capture whose first judgements came before the full ones.
    late = [r for n, r in enumerate(records) if not r.key.endswith("/votes") or n > len(records) // 3]
    assert judge_again(write(late), ReplayChange()).faithful


def test_without_the_full_votes_labels_are_compared_and_no_bits(write):
    records = [r for r in recorded(a_scene(), steps(), short=True) if not r.key.endswith("/votes")]
    result = judge_again(write(records), ReplayChange())
    assert labels(result) == ["bowing", "lunging", "stretch"] and result.same < result.judgements
    assert all(row.partly and row.stands for row in result.rows) and result.faithful


def test_the_wait_for_the_roster_is_replayed(write):
    """At the start two observers see a movement that they cannot tell, before the third has begun."""
    early = steps([(0.3, 0.6, {"door": "bowing", "corner": "lunging"}), (1.0, 0.0, {})], seed=1)
    alone = [(at - 3_000_000_000, [m.with_fields(captured_ns=m.captured_ns - 3_000_000_000,
              sent_ns=m.sent_ns - 3_000_000_000) for m in few[:2]]) for at, few in early]  # fmt: skip
    later = [(at, [m.with_fields(seq=m.seq + 100) for m in few]) for at, few in steps()]
    engine = new_engine(scene := a_scene())
    engine.wait_for_roster(scene.fusion.start_s)
    result = judge_again(write(recorded(scene, [*alone, *later], engine)), ReplayChange())
    assert labels(result) == ["bowing", "lunging", "stretch"] and result.faithful
    assert result.same == result.judgements == len(alone) + len(later)


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    play=st.lists(
        st.tuples(
            st.floats(0.1, 1.5),
            st.floats(0, 1.5),
            st.dictionaries(st.sampled_from(OBSERVERS), st.sampled_from(NAMES.labels)),
        ),
        min_size=1,
        max_size=4,
    ),
    rule=st.sampled_from(("guarded_product", "inverse_entropy", "log", "min_entropy", "product")),
    seed=st.integers(0, 99),
)
def test_any_run_comes_out_the_same(write, play, rule, seed):
    scene = a_scene(rule=rule)
    # The rule is the one that the judgements name, not that of the scene file.
    result = judge_again(write(recorded(scene, steps(play, seed)), a_scene(rule="log")), ReplayChange())
    assert result.same == result.judgements and result.faithful


def revised_records(scene):
    """The records of one movement whose label is corrected when the person comes to rest."""
    story = [(None, 0.98)] * 3 + [("bowing", 0.02)] * 2 + [("lunging", 0.02)] * 6 + [("lunging", 0.98)] * 6
    played = [
        (at, [posterior(o, n, at, label, rest=rest) for o in OBSERVERS])
        for n, (label, rest) in enumerate(story, 1)
        for at in [NOON + n * STEP]
    ]
    return recorded(scene, played)


def test_a_revision_belongs_to_its_movement_and_comes_out_the_same(write):
    scene = a_scene(hold_s=0.1)
    records = revised_records(scene)
    result = judge_again(write(records, scene), ReplayChange())
    (row,) = result.rows
    assert [record.verdict.stage for record in row.recorded] == ["decided", "revised", "ended"]
    assert row.likeness == "bit for bit" and result.faithful
    assert re.search(r"bowing -> lunging +3 of 3 +bowing -> lunging +3 of 3 +bit for bit", as_text(result, "a", True))
    assert as_json(result, "a", True)["verdicts"][0]["anew"]["revises"] == "bowing"
    for cut in judgements(records):
        part = judge_again(write(records[:1] + records[cut:], scene), ReplayChange())
        assert part.faithful and all(row.stands or row.partly for row in part.rows), cut


def test_optional_fields_come_out_the_same(write):
    """Unlearned, facing and facets, also after they fade, and the learned reliability."""
    rng, played = np.random.default_rng(1), []
    for n, (at_ns, posteriors) in enumerate(steps(PLAY * 2)):
        more = {
            "unlearned": rng.uniform(0, 0.3),
            "facing": Facing(surprise=rng.integers(0, 40, (NAMES.size, 4)).tolist()),
            "facets": {"effort_time": [0.25, 0.75]},
        }
        # The wheel publishes rarely, so that its posterior fades; the corner sends none of these fields.
        speaks = [m for m in posteriors if m.observer != "wheel" or n % 6 == 0]
        messages = [m if m.observer == "corner" else m.with_fields(**more) for m in speaks]
        played.append((at_ns, messages))
    records = recorded(a_scene(temperature=1.3), played)
    result = judge_again(write(records, a_scene(temperature=1.3)), ReplayChange())
    assert result.same == result.judgements and result.faithful
    assert any(b"contributions" in record.payload for record in records)


def test_scores_come_out_the_same(write):
    """Votes carry none: they are those of the recorded verdict, and a change leaves none."""
    played = [
        (at_ns, [m if m.rest < 0.5 else m.with_fields(score=scored(m.captured_ns)) for m in posteriors])
        for at_ns, posteriors in steps()
    ]
    records = recorded(a_scene(), played)
    result = judge_again(write(records), ReplayChange())
    assert [row.last_replayed.score for row in result.rows] == [None, None, 7.5] and result.faithful
    changed = judge_again(write(records), ReplayChange(without=("wheel",)))
    assert changed.rows[-1].last_replayed.score is None


def scored(at_ns):
    """What each says at rest: a score of a stretch that ended just now."""
    return ObservedScore(label="stretch", ended_ns=at_ns, score=7.5)


def test_contested_rest_comes_out_the_same(write):
    """Two that contradict each other about rest, until one of them knows what is done; then that one fades."""
    played = []
    for n in range(1, 240):
        at_ns, label = NOON + n * STEP, "bowing" if n // 15 % 2 else None
        door = posterior("door", n, at_ns, label if n > 100 else None, rest=0.02 if label else 0.98)
        corner = posterior("corner", n, at_ns, rest=0.98 if label else 0.02)
        played.append((at_ns, [door, corner] if n < 160 or n % 8 == 0 else [corner]))
    engine = new_engine(scene := a_scene(quorum=1))
    engine.wait_for_roster(scene.fusion.start_s)
    records = recorded(scene, played, engine, short=True)
    whys = [decode(JudgementMessage, r.payload).why or "" for r in records if r.key == f"{ROOT}/judgement"]
    assert any(why.startswith(CONTESTED_REST) for why in whys)
    result = judge_again(write(records, scene), ReplayChange())
    assert result.rows and result.faithful and result.same == result.judgements == len(played)


def test_a_forged_verdict_and_a_changed_vote_are_noticed(write, records):
    place = next(n for n, record in enumerate(records) if record.key.endswith("/verdict"))
    was = records[place]
    forged = was.payload.replace(b"\xa5label\xa6bowing\xaecertainty", b"\xa5label\xa7lunging\xaecertainty")
    changed = [*records[:place], CaptureRecord("put", was.key, forged, was.arrived_ns), *records[place + 1 :]]
    result = judge_again(write(changed), ReplayChange())
    assert result.rows[0].likeness == "same label" and not result.faithful  # its last word was as it is now
    assert "reasons for a difference" in as_text(result, "a.mcap", True)
    for n in judgements(records)[:40]:
        was = records[n]
        records[n] = CaptureRecord("put", was.key, was.payload.replace(b"bowing", b"lungin"), was.arrived_ns)
    result = judge_again(write(records), ReplayChange())
    assert result.same < result.judgements


def test_a_capture_of_a_part_is_exact_in_that_part(write, records):
    # A step has four records: each kind of them is the first and the last of a part.
    for end in range(judgements(records)[0] + 1, len(records), 11):
        assert judge_again(write(records[:end]), ReplayChange()).faithful
    for start in range(0, len(records), 13):
        result = judge_again(write(records[:1] + records[start:]), ReplayChange())
        assert result.faithful
        whole = [row.likeness for row in result.rows if not row.partly]
        assert whole == ["bit for bit"] * len(whole)
        assert len(result.rows) - len(whole) <= 1
        # The first judgement only sets the state; an open movement may have been decided earlier: since when a label is
        # held is not in a capture, and a contested one has to be for 0.3 s longer, three steps.
        assert result.judgements - 6 <= result.same < result.judgements or start == 0
        assert result.same >= result.judgements - 1 or result.rows[0].partly


def test_a_movement_decided_before_the_capture_ends_with_its_queried_verdict(write, records):
    decided = next(n for n, record in enumerate(records) if record.key == f"{ROOT}/verdict")
    answer = CaptureRecord("answer", f"{ROOT}/verdict", records[decided].payload, NOON)
    result = judge_again(write([records[0], answer, *records[decided + 2 :]]), ReplayChange())
    assert [len(row.recorded) for row in result.rows] == [1, 2, 2]
    assert [row.likeness for row in result.rows] == ["bit for bit"] * 3


def test_missing_judgements_are_counted_and_the_numbering_continues(write, records):
    quiet = judgements(records)[2]
    result = judge_again(write(records[:quiet] + records[quiet + 1 :]), ReplayChange())
    assert result.missing == 1
    assert [row.likeness for row in result.rows] == ["bit for bit"] * 3
    assert "1 more not captured" in as_text(result, "a.mcap", True)


def test_another_service_takes_over_in_the_middle_of_a_movement(write):
    scene = a_scene()
    whole = steps()
    first = new_engine(scene)
    second = FusionEngine("dojo", list(OBSERVERS), NAMES, scene.fusion.model_copy(update={"id": "second"}))
    cut = 12  # bowing is decided and goes on
    records = recorded(scene, whole[:cut], first)
    for at_ns, posteriors in whole[:cut]:
        output = step(second, {message.observer: message for message in posteriors}, at_ns)
    follow_all(second, records)
    assert output.judgement.movement is not None
    recorded(scene, whole[cut:], second, records)
    result = judge_again(write(records, scene), ReplayChange())
    assert result.same == result.judgements and result.faithful
    assert {row.last_recorded.fusion for row in result.rows} == {"second"}


def follow_all(engine, records):
    for record in records:
        kind = {"judgement": JudgementMessage, "verdict": VerdictMessage}.get(record.key.rsplit("/", 1)[-1])
        if kind is not None:
            engine.continue_from(decode(kind, record.payload))


@pytest.mark.parametrize("cut", [7, 10])
@pytest.mark.parametrize("memory", [False, True])
def test_a_restarted_service(write, memory, cut):
    scene, whole = a_scene(), steps()
    records = recorded(scene, whole[:cut])
    alive = f"{ROOT}/fusion/fusion/alive"
    records += [CaptureRecord("token", alive, GONE, NOON), CaptureRecord("token", alive, APPEARED, NOON)]
    again = new_engine(scene)
    if memory:
        follow_all(again, records)
    recorded(scene, whole[cut + 1 :], again, records)
    result = judge_again(write(records, scene), ReplayChange())
    assert result.same == result.judgements and result.faithful


@pytest.mark.parametrize("contests", [False, True])
def test_without_an_observer_the_verdicts_are_those_of_the_others(write, contests):
    """To the bit, unless it contested a label: then what others learned of each other is of a later step."""
    agreed = [(rest_s, move_s, dict.fromkeys(held, held.get("door"))) for rest_s, move_s, held in PLAY]
    played = steps(PLAY if contests else agreed)
    result = judge_again(write(recorded(a_scene(), played)), ReplayChange(without=("corner",)))
    alone = new_engine(a_scene(), ("door", "wheel"))
    verdicts = []
    for at_ns, posteriors in played:
        verdicts += step(alone, {message.observer: message for message in posteriors}, at_ns).verdicts
    replayed = [record.payload for row in result.rows for record in row.replayed]
    assert contests or replayed == [encode(verdict) for verdict in verdicts]
    times = [(one.id, one.stage, one.label, one.decided_ns, one.ended_ns) for one in verdicts]
    again = [decode(VerdictMessage, payload) for payload in replayed]
    assert [(one.id, one.stage, one.label, one.decided_ns, one.ended_ns) for one in again] == times
    assert labels(result) == ["bowing", "lunging", "stretch"] and result.faithful


def test_a_verdict_falls_without_its_decisive_observer(write, records):
    capture = write(records)
    result = judge_again(capture, ReplayChange(without=("wheel",)))
    assert labels(result) == ["bowing", "abstain", "stretch"]
    text = as_text(result, "a.mcap", True)
    assert "without wheel: 2 of 3 verdicts stand" in text
    assert [row["stands"] for row in as_json(result, "a.mcap", True)["verdicts"]] == [True, False, True]
    # The quorum is at most the number of remaining observers.
    assert labels(judge_again(capture, ReplayChange(without=("door", "wheel")))) == ["bowing", "stretch", "stretch"]


def test_other_rule_quorum_and_threshold(write, records):
    capture = write(records)
    assert labels(judge_again(capture, ReplayChange(quorum=3))) == ["bowing", "abstain", "stretch"]
    assert labels(judge_again(capture, ReplayChange(threshold=0.999999))) == ["abstain"] * 3
    rules = (ReplayChange(rule=rule, threshold=0.8) for rule in ("log", "product"))
    by_log, by_product = (labels(judge_again(capture, change)) for change in rules)
    assert by_log != by_product


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"without": ("left",)}, "--without left: not in the scene; known: door, corner, wheel"),
        ({"without": OBSERVERS}, "no observer would be left"),
        ({"without": ("door",), "quorum": 3}, "--quorum 3: only 2 observers"),
        ({"rule": "lag"}, "--rule 'lag': unknown rule; did you mean '?log"),
        ({"rule": "iest"}, "--rule 'iest': this rule is gone; use 'inverse_entropy'"),
    ],
)
def test_impossible_changes_are_rejected(write, records, changes, error):
    with pytest.raises(BadInput, match=error):
        judge_again(write(records), ReplayChange(**changes))


def test_the_default_rule_judges_a_capture_of_a_rule_that_is_gone_and_says_so(write, records):
    scene = a_scene(rule="iest")
    old = [
        replace(
            record,
            payload=encode(decode(JudgementMessage, record.payload).model_copy(update={"rule": "iest"}), full=True),
        )
        if record.key == f"{ROOT}/judgement"
        else record
        for record in records
    ]
    result = judge_again(write(old, scene), ReplayChange())
    assert labels(result) == labels(judge_again(write(records), ReplayChange())) and result.faithful
    first = as_text(result, "a.mcap", True).splitlines()[1]
    assert first == "judged again from its judgements; its rule 'iest' is gone, 'guarded_product' judges in its place"
    assert as_json(result, "a.mcap", True)["change"]["gone"] == "iest"
    assert judge_again(write(old, scene), ReplayChange(rule="log")).change.gone is None


def test_durations_that_the_service_took_while_it_ran_are_taken_at_the_same_step(write):
    play = [(0.5, 1.5, dict.fromkeys(OBSERVERS, "bowing")), (0.7, 1.0, dict.fromkeys(OBSERVERS, "bowing"))]
    played, engine, records = steps([*play, *play, (1.5, 0.0, {})]), new_engine(a_scene()), []
    times = replace(NAMES, movements={"bowing": MovementTimes(rest_s=1.0, period_s=0.5)})
    for vocabulary, part in ((NAMES, played[:40]), (times, played[40:])):
        engine.take_times(vocabulary)
        own = CaptureRecord("put", f"{ROOT}/vocabulary", encode_vocabulary("dojo", vocabulary, "fusion"), part[0][0])
        records = recorded(a_scene(), part, engine, [*records, own])
    result = judge_again(write(records), ReplayChange())
    assert result.faithful and result.same == result.judgements and labels(result) == ["bowing"] * 3


def test_captures_that_cannot_be_judged_are_errors(write, records):
    with pytest.raises(LabanmeshError, match=r"the names of the movements .* are not in the capture"):
        judge_again(write(records[1:]), ReplayChange())
    named = a_scene().model_copy(update={"vocabulary": NAMES.labels})
    assert judge_again(write(records[1:], named), ReplayChange()).faithful
    with pytest.raises(LabanmeshError, match="contains no judgements"):
        judge_again(write(records[:1]), ReplayChange())


def test_movements_belong_together_by_id_else_by_time(write, records):
    result = judge_again(write(records), ReplayChange())
    recorded = [record for row in result.rows for record in row.recorded]

    def moved(record, by_ns, name):
        verdict = record.verdict
        ended_ns = verdict.ended_ns and verdict.ended_ns + by_ns
        times = {"began_ns": verdict.began_ns + by_ns, "ended_ns": ended_ns, "id": name}
        return VerdictRecord(verdict.model_copy(update=times), b"")

    late = [moved(record, STEP, f"n{record.verdict.id}") for record in recorded]
    assert [len(row.recorded) * len(row.replayed) for row in compare_verdicts(recorded, late, ())] == [4, 4, 4]
    far = [moved(record, 10**12, f"n{record.verdict.id}") for record in recorded]
    rows = compare_verdicts(recorded, far, ())
    assert [row.likeness for row in rows] == ["not judged"] * 3 + ["not recorded"] * 3
    assert [row.partly for row in compare_verdicts(recorded, [], [Gap(0, result.rows[0].began_ns)])] == [
        True,
        False,
        False,
    ]


def test_the_reader_in_the_documentation_works_alone(write, records):
    (code,) = re.findall(r"```python\n(.*?)```", (HOUSE / "docs" / "guide" / "replay.md").read_text("utf-8"), re.DOTALL)
    capture = write(records)
    command = [sys.executable, "-I", "-c", code, str(capture.path)]
    output = subprocess.run(command, capture_output=True, text=True, check=True, timeout=SOON_S).stdout
    assert [line.split()[2] for line in output.splitlines()] == ["bowing"] * 2 + ["lunging"] * 2 + ["stretch"] * 2


def test_the_command_prints_the_result_and_its_status(write, records, tmp_path, capsys):
    good = write(records, name="good.mcap").path
    for n, record in enumerate(records):
        if record.key.endswith("/verdict"):
            wrong = record.payload.replace(b"\xa5label\xa6bowing\xaec", b"\xa5label\xa7stretch\xaec")
            records[n] = CaptureRecord("put", record.key, wrong, record.arrived_ns)
    bad = write(records, name="bad.mcap").path
    assert labanmesh.main(["replay", str(good)]) == 0
    out = capsys.readouterr().out
    assert "3 of 3 verdicts the same bit for bit" in out and out.count("bit for bit\n") == 3
    assert labanmesh.main(["replay", str(bad), "--json"]) == 1
    printed = json.loads(capsys.readouterr().out)
    assert [row["likeness"] for row in printed["verdicts"]] == ["another label", "bit for bit", "bit for bit"]
    assert labanmesh.main(["replay", str(bad), "--without", "wheel"]) == 0
    capsys.readouterr()
    for words in (["none.mcap"], [str(good), "--speed", "2"]):
        assert labanmesh.main(["replay", *words]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_a_compressed_chunk_is_never_unpacked(write, capsys):
    """2.9 GB of zeros in 91 KB: the file of an attacker, whose length says nothing of its contents."""
    path = write([]).path
    head = path.read_bytes()
    compressor = zstandard.ZstdCompressor(level=1).compressobj()
    zeros = bytes(10_000_000)
    bomb = b"".join(compressor.compress(zeros) for _ in range(290)) + compressor.flush()
    body = struct.pack("<QQQI", 0, 0, 2_900_000_000, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(bomb))
    chunk = b"\x06" + struct.pack("<Q", len(body) + len(bomb)) + body + bomb
    data_end = head.rindex(b"\x0f" + struct.pack("<Q", 4))
    path.write_bytes(head[:data_end] + chunk + head[data_end:])
    assert labanmesh.main(["replay", str(path)]) == 1
    error = capsys.readouterr().err
    assert "holds chunks, which captures do not have" in error and error.count("\n") == 1
