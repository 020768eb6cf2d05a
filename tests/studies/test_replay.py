"""Replay: a capture judged anew gives the same verdicts, bit for bit; and what it would be with something changed."""

import json
import re
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import labanmesh
from common.capture_file import APPEARED, GONE, CaptureFile, CaptureRecord, CaptureWriter
from common.config import FusionConfig, ObserverConfig, Scene
from common.errors import BadInput, LabanmeshError
from common.messages import PosteriorMessage, StatusMessage, VocabularyReference
from common.vocabulary import Vocabulary
from common.wire import encode, encode_vocabulary
from fusion.engine.engine import FusionEngine
from studies.replay.comparison import VerdictRecord, as_json, as_text, compare_verdicts
from studies.replay.from_judgements import Gap, ReplayChange
from studies.replay.judging import judge_again

HOUSE = Path(__file__).parents[2]
NOON = 1_795_000_000_000_000_000
STEP = 100_000_000
NAMES = Vocabulary(("bowing", "lunging", "stretch"))
REFERENCE = VocabularyReference(name=NAMES.name, hash=NAMES.digest)
OBSERVERS = ("door", "corner", "wheel")
ROOT = "laban/dojo"
# Seconds at rest, then of a movement, and what each observer then holds it for.
PLAY = [
    (0.5, 1.5, {"door": "bowing", "corner": "bowing", "wheel": "bowing"}),
    (1.0, 1.5, {"door": "lunging", "corner": "stretch", "wheel": "lunging"}),
    (1.0, 1.5, {"door": "stretch", "corner": "stretch", "wheel": "stretch"}),
    (1.5, 0.0, {}),
]


def a_scene(**fusion):
    fusion = FusionConfig(**{"quorum": 2, **fusion})
    observers = {name: ObserverConfig(source="m.npz") for name in OBSERVERS}
    return Scene(scene="dojo", observers=observers, fusion=fusion)


def belief(label, certainty):
    p = np.full(NAMES.size, (1 - certainty) / (NAMES.size - 1))
    p[NAMES.index(label)] = certainty
    return [float(x) for x in p]


def posterior(observer, seq, at_ns, label=None, certainty=0.9, **more):
    p = [1 / NAMES.size] * NAMES.size if label is None else belief(label, certainty)
    said = {"captured_ns": at_ns, "sent_ns": at_ns, "rest": 0.98 if label is None else 0.02, "frames": seq, **more}
    return PosteriorMessage(
        scene="dojo", observer=observer, seq=seq, session="s", vocabulary=REFERENCE, p=p, **said
    )  # fmt: skip


def key_of(observer, what="posterior"):
    return f"{ROOT}/observer/{observer}/{what}"


def lots(play=PLAY, seed=0):
    """(time, posteriors) of each step."""
    rng, steps, at_ns = np.random.default_rng(seed), [], NOON
    for rest_s, move_s, held in play:
        for labels, length_s in (({}, rest_s), (held, move_s)):
            for _ in range(round(length_s * 1e9 / STEP)):
                at_ns += STEP
                steps.append((at_ns, labels))
    return [
        (at, [posterior(o, n, at - 7_000_000, held.get(o), rng.uniform(0.9, 0.99)) for o in OBSERVERS])
        for n, (at, held) in enumerate(steps, 1)
    ]


def judged(scene, played, referee=None, records=None):
    """The records of a mesh on which a referee judges what is played."""
    referee = referee or FusionEngine("dojo", list(OBSERVERS), NAMES, scene.fusion)
    records = (
        [CaptureRecord("answer", f"{ROOT}/vocabulary", encode_vocabulary("dojo", NAMES), NOON)]
        if records is None
        else records
    )
    for at_ns, posteriors in played:
        for message in posteriors:
            records.append(CaptureRecord("put", key_of(message.observer), encode(message), at_ns))
            referee.receive(message.observer, message, at_ns)
        ruling = referee.step(at_ns)
        for verdict in ruling.verdicts:
            records.append(CaptureRecord("put", f"{ROOT}/verdict", encode(verdict), at_ns))
        records.append(CaptureRecord("put", f"{ROOT}/judgement", encode(ruling.judgement), at_ns + 1))
    return records


@pytest.fixture
def kept(tmp_path):
    def keep(records, scene=None, name="a.mcap"):
        path = tmp_path / name
        path.unlink(missing_ok=True)
        with CaptureWriter(path, scene or a_scene(), "", NOON) as writer:
            for record in records:
                writer.write(record)
        return CaptureFile(path)

    return keep


def labels(found, which="last_replayed"):
    return [verdict and verdict.label for verdict in (getattr(row, which) for row in found.rows)]


def judgements(records):
    return [n for n, record in enumerate(records) if record.key == f"{ROOT}/judgement"]


def test_the_same_verdicts_bit_for_bit(kept):
    found = judge_again(kept(judged(a_scene(), lots())), ReplayChange())
    assert labels(found, "last_recorded") == ["bowing", "lunging", "stretch"]
    assert [row.likeness for row in found.rows] == ["bit for bit"] * 3
    assert [len(row.recorded) for row in found.rows] == [2, 2, 2]
    assert found.same == found.judgements == len(lots()) and found.missing == 0
    assert found.faithful and found.source == "judgements"


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
    rule=st.sampled_from(("robust_inverse_entropy", "inverse_entropy", "log", "median", "product")),
    seed=st.integers(0, 99),
)
def test_whatever_was_judged_comes_out_the_same(kept, play, rule, seed):
    scene = a_scene(rule=rule)
    found = judge_again(kept(judged(scene, lots(play, seed)), scene), ReplayChange())
    assert found.same == found.judgements and found.faithful


def test_what_is_said_beside_the_movements_comes_out_the_same_too(kept):
    """Something else, facing, facets, also when they have faded; and what was learned of the judges meanwhile."""
    rng, played = np.random.default_rng(1), []
    for n, (at_ns, posteriors) in enumerate(lots(PLAY * 2)):
        more = {
            "unlearned": rng.uniform(0, 0.3),
            "facing": {"surprise": rng.integers(0, 40, (NAMES.size, 4)).tolist()},
            "facets": {"effort_time": [0.25, 0.75]},
        }
        # The wheel says it now and then only, so that its opinion fades; the corner says none of it.
        speaks = [m for m in posteriors if m.observer != "wheel" or n % 6 == 0]
        told = [
            m if m.observer == "corner" else PosteriorMessage.model_validate({**m.model_dump(), **more}) for m in speaks
        ]
        played.append((at_ns, told))
    records = judged(a_scene(temperature=1.3), played)
    found = judge_again(kept(records, a_scene(temperature=1.3)), ReplayChange())
    assert found.same == found.judgements and found.faithful
    assert any(b"contributions" in record.payload for record in records)


def test_a_changed_vote_is_noticed(kept):
    records = judged(a_scene(), lots())
    for n in judgements(records)[:40]:
        was = records[n]
        records[n] = CaptureRecord("put", was.key, was.payload.replace(b"bowing", b"lungin"), was.arrived_ns)
    found = judge_again(kept(records), ReplayChange())
    assert found.same < found.judgements


def test_a_verdict_that_was_not_so_is_noticed(kept):
    records = judged(a_scene(), lots())
    said = next(n for n, record in enumerate(records) if record.key.endswith("/verdict"))
    forged = records[said].payload.replace(b"\xa5label\xa6bowing\xaecertainty", b"\xa5label\xa7lunging\xaecertainty")
    assert forged != records[said].payload
    records[said] = CaptureRecord("put", records[said].key, forged, records[said].arrived_ns)
    found = judge_again(kept(records), ReplayChange())
    assert found.rows[0].likeness == "same label" and not found.faithful  # its last word was as it is now
    assert "reasons for a difference" in as_text(found, "a.mcap", True)


def test_a_capture_that_began_in_the_middle_is_exact_after_that(kept):
    records = judged(a_scene(), lots())
    for start in range(0, len(records), 7):
        found = judge_again(kept(records[:1] + records[start:]), ReplayChange())
        assert found.faithful
        whole = [row.likeness for row in found.rows if not row.partly]
        assert whole == ["bit for bit"] * len(whole)
        assert len(found.rows) - len(whole) <= 1
        # The first is where it begins; where the open movement was decided is not known beforehand.
        assert found.judgements - 3 <= found.same < found.judgements or start == 0
        assert found.same >= found.judgements - 1 or found.rows[0].partly


def test_what_was_decided_before_the_capture_ends_on_the_grounds_that_were_told(kept):
    records = judged(a_scene(), lots())
    decided = next(n for n, record in enumerate(records) if record.key == f"{ROOT}/verdict")
    told = CaptureRecord("answer", f"{ROOT}/verdict", records[decided].payload, NOON)
    found = judge_again(kept([records[0], told, *records[decided + 2 :]]), ReplayChange())
    assert [len(row.recorded) for row in found.rows] == [1, 2, 2]
    assert [row.likeness for row in found.rows] == ["bit for bit"] * 3


def test_the_rule_is_the_one_that_the_judgements_name(kept):
    found = judge_again(kept(judged(a_scene(rule="median"), lots()), a_scene(rule="log")), ReplayChange())
    assert found.same == found.judgements and found.faithful


def test_cut_off_anywhere_nothing_is_wrong(kept):
    records = judged(a_scene(), lots())
    for end in range(judgements(records)[0] + 1, len(records), 5):
        assert judge_again(kept(records[:end]), ReplayChange()).faithful


def test_judgements_that_were_not_heard_are_counted_and_the_rest_is_numbered_as_it_was(kept):
    records = judged(a_scene(), lots())
    quiet = judgements(records)[2]
    found = judge_again(kept(records[:quiet] + records[quiet + 1 :]), ReplayChange())
    assert found.missing == 1
    assert [row.likeness for row in found.rows] == ["bit for bit"] * 3
    assert "1 more not captured" in as_text(found, "a.mcap", True)


def test_another_service_takes_over_in_the_middle_of_a_movement(kept):
    scene = a_scene()
    whole = lots()
    first = FusionEngine("dojo", list(OBSERVERS), NAMES, scene.fusion)
    second = FusionEngine("dojo", list(OBSERVERS), NAMES, scene.fusion.model_copy(update={"id": "second"}))
    cut = 12  # bowing is decided and goes on
    records = judged(scene, whole[:cut], first)
    for at_ns, posteriors in whole[:cut]:
        for message in posteriors:
            second.receive(message.observer, message, at_ns)
        ruling = second.step(at_ns)
    follow_all(second, records)
    assert ruling.judgement.movement is not None
    judged(scene, whole[cut:], second, records)
    found = judge_again(kept(records, scene), ReplayChange())
    assert found.same == found.judgements and found.faithful
    assert {row.last_recorded.fusion for row in found.rows} == {"second"}


def follow_all(referee, records):
    from common.messages import JudgementMessage, VerdictMessage
    from common.wire import decode

    for record in records:
        kind = {"judgement": JudgementMessage, "verdict": VerdictMessage}.get(record.key.rsplit("/", 1)[-1])
        if kind is not None:
            referee.continue_from(decode(kind, record.payload))


@pytest.mark.parametrize("cut", [7, 10])
@pytest.mark.parametrize("memory", [False, True])
def test_a_service_that_was_started_anew(kept, memory, cut):
    scene, whole = a_scene(), lots()
    records = judged(scene, whole[:cut])
    alive = f"{ROOT}/fusion/fusion/alive"
    records += [CaptureRecord("token", alive, GONE, NOON), CaptureRecord("token", alive, APPEARED, NOON)]
    again = FusionEngine("dojo", list(OBSERVERS), NAMES, scene.fusion)
    if memory:
        follow_all(again, records)
    judged(scene, whole[cut + 1 :], again, records)
    found = judge_again(kept(records, scene), ReplayChange())
    assert found.same == found.judgements and found.faithful


def test_without_an_observer_it_is_as_if_he_had_not_been_there(kept):
    played = lots()
    found = judge_again(kept(judged(a_scene(), played)), ReplayChange(without=("corner",)))
    alone = FusionEngine("dojo", ["door", "wheel"], NAMES, a_scene().fusion)
    said = []
    for at_ns, posteriors in played:
        for message in posteriors:
            alone.receive(message.observer, message, at_ns)
        said += [encode(verdict) for verdict in alone.step(at_ns).verdicts]
    assert [saying.payload for row in found.rows for saying in row.replayed] == said
    assert labels(found) == ["bowing", "lunging", "stretch"] and found.faithful


def test_without_the_one_who_turned_the_scales_it_does_not_stand(kept):
    capture = kept(judged(a_scene(), lots()))
    found = judge_again(capture, ReplayChange(without=("wheel",)))
    assert labels(found) == ["bowing", "abstain", "stretch"]
    told = as_text(found, "a.mcap", True)
    assert "without wheel: 2 of 3 verdicts stand" in told
    assert [row["stands"] for row in as_json(found, "a.mcap", True)["verdicts"]] == [True, False, True]
    # The quorum is two still; of one who remains it can but be one.
    assert labels(judge_again(capture, ReplayChange(without=("door", "wheel")))) == ["bowing", "stretch", "stretch"]


def test_other_rule_quorum_and_threshold(kept):
    capture = kept(judged(a_scene(), lots()))
    assert labels(judge_again(capture, ReplayChange(quorum=3))) == ["bowing", "abstain", "stretch"]
    assert labels(judge_again(capture, ReplayChange(threshold=0.999999))) == ["abstain"] * 3
    assert labels(judge_again(capture, ReplayChange(rule="log"))) != labels(
        judge_again(capture, ReplayChange(rule="median"))
    )


def test_changes_that_cannot_be_are_refused(kept):
    capture = kept(judged(a_scene(), lots()))
    with pytest.raises(BadInput, match="--without left: not in the scene; known: door, corner, wheel"):
        judge_again(capture, ReplayChange(without=("left",)))
    with pytest.raises(BadInput, match="no observer would be left"):
        judge_again(capture, ReplayChange(without=OBSERVERS))
    with pytest.raises(BadInput, match="--quorum 3: only 2 observers"):
        judge_again(capture, ReplayChange(without=("door",), quorum=3))
    with pytest.raises(BadInput, match=r"'lag': unknown rule; did you mean 'log'"):
        judge_again(capture, ReplayChange(rule="lag"))


def test_from_posteriors_it_is_what_the_referee_said(kept):
    records = judged(a_scene(), lots())
    found = judge_again(kept(records), ReplayChange(), "posteriors")
    assert labels(found) == ["bowing", "lunging", "stretch"] and found.faithful
    unjudged = [record for record in records if "/observer/" in record.key or record.kind == "answer"]
    found = judge_again(kept(unjudged), ReplayChange())
    assert (found.source, labels(found)) == ("posteriors", ["bowing", "lunging", "stretch"])
    assert labels(judge_again(kept(unjudged), ReplayChange(without=("wheel",)))) == ["bowing", "abstain", "stretch"]


def test_from_posteriors_the_bad_ones_change_nothing_and_who_goes_is_silent(kept):
    records = [r for r in judged(a_scene(), lots()) if "/observer/" in r.key or r.kind == "answer"]
    bad = [b"", b"\xc1", b"\x81\xa1v\x02"]
    noisy = [records[0]]
    for n, record in enumerate(records[1:]):
        noisy += [record, CaptureRecord("put", key_of("wheel"), bad[n % len(bad)], record.arrived_ns)]
        stolen = encode(posterior("door", 10_000 + n, record.arrived_ns, "stretch"))
        noisy.append(CaptureRecord("put", key_of("wheel"), stolen, record.arrived_ns))
    quiet = judge_again(kept(records), ReplayChange())
    loud = judge_again(kept(noisy), ReplayChange())
    assert [row.last_replayed.label for row in loud.rows] == [row.last_replayed.label for row in quiet.rows]
    assert [row.began_ns for row in loud.rows] == [row.began_ns for row in quiet.rows]
    # Both others go as the last movement begins: one is left, and no quorum.
    last = quiet.rows[-1].began_ns
    gone = [CaptureRecord("token", key_of(o, "alive"), APPEARED, NOON) for o in OBSERVERS]
    gone += [r for r in records if r.arrived_ns <= last or "/door/" in r.key]
    at = next(n for n, r in enumerate(gone) if r.arrived_ns > last)
    gone[at:at] = [CaptureRecord("token", key_of(o, "alive"), GONE, last) for o in ("corner", "wheel")]
    assert labels(judge_again(kept(gone), ReplayChange())) == ["bowing", "lunging", "abstain"]


def test_from_posteriors_time_passes_while_nobody_speaks(kept):
    records = [r for r in judged(a_scene(), lots()) if "/observer/" in r.key or r.kind == "answer"]
    open_end = [r for r in records if r.arrived_ns <= NOON + 18 * STEP]
    (row,) = judge_again(kept(open_end), ReplayChange()).rows
    assert row.last_replayed.ended_ns is None
    later = CaptureRecord("put", f"{ROOT}/fusion/fusion/status", b"", NOON + 60 * STEP)
    (row,) = judge_again(kept([*open_end, later]), ReplayChange()).rows
    # Past drop_s everybody is silent, and that is rest.
    assert row.last_replayed.ended_ns == pytest.approx(NOON + 18 * STEP + 2 * 10**9, abs=2 * STEP)


def test_from_posteriors_a_clock_that_is_wrong_is_corrected_by_its_status(kept):
    hour = 3600 * 10**9
    records = []
    for record in judged(a_scene(), lots()):
        if "/observer/" in record.key:
            said = status(record.arrived_ns - hour)
            at_ns = record.arrived_ns
            records += [CaptureRecord("put", key_of("wheel", "status"), said, at_ns)] if "/wheel/" in record.key else []
            records.append(shifted(record, -hour) if "/wheel/" in record.key else record)
        elif record.kind == "answer":
            records.append(record)
    assert labels(judge_again(kept(records), ReplayChange())) == ["bowing", "lunging", "stretch"]


def status(at_ns):
    return encode(StatusMessage(scene="dojo", id="wheel", state="running", at_ns=at_ns))


def shifted(record, by_ns):
    from common.wire import decode

    message = decode(PosteriorMessage, record.payload)
    times = {"captured_ns": message.captured_ns + by_ns, "sent_ns": message.sent_ns + by_ns}
    return CaptureRecord(record.kind, record.key, encode(message.model_copy(update=times)), record.arrived_ns)


def test_what_cannot_be_judged_is_said(kept):
    records = judged(a_scene(), lots())
    with pytest.raises(LabanmeshError, match=r"the names of the movements .* are not in the capture"):
        judge_again(kept(records[1:]), ReplayChange())
    named = a_scene().model_copy(update={"vocabulary": NAMES.labels})
    assert judge_again(kept(records[1:], named), ReplayChange()).faithful
    with pytest.raises(LabanmeshError, match="contains no posteriors"):
        judge_again(kept(records[:1]), ReplayChange())
    with pytest.raises(LabanmeshError, match="contains no judgements"):
        judge_again(kept(records[:2]), ReplayChange(), "judgements")


def test_movements_belong_together_by_id_else_by_time(kept):
    found = judge_again(kept(judged(a_scene(), lots())), ReplayChange())
    recorded = [saying for row in found.rows for saying in row.recorded]

    def moved(saying, by_ns, name):
        verdict = saying.verdict
        ended_ns = verdict.ended_ns and verdict.ended_ns + by_ns
        times = {"began_ns": verdict.began_ns + by_ns, "ended_ns": ended_ns, "id": name}
        return VerdictRecord(verdict.model_copy(update=times), b"")

    late = [moved(saying, STEP, f"n{saying.verdict.id}") for saying in recorded]
    assert [len(row.recorded) * len(row.replayed) for row in compare_verdicts(recorded, late, ())] == [4, 4, 4]
    far = [moved(saying, 10**12, f"n{saying.verdict.id}") for saying in recorded]
    rows = compare_verdicts(recorded, far, ())
    assert [row.likeness for row in rows] == ["not judged"] * 3 + ["not recorded"] * 3
    assert [row.partly for row in compare_verdicts(recorded, [], [Gap(0, found.rows[0].began_ns)])] == [
        True,
        False,
        False,
    ]


def test_the_reader_in_the_document_needs_nothing_of_ours(kept):
    (code,) = re.findall(r"```python\n(.*?)```", (HOUSE / "docs" / "guide" / "replay.md").read_text("utf-8"), re.DOTALL)
    capture = kept(judged(a_scene(), lots()))
    command = [sys.executable, "-I", "-c", code, str(capture.path)]
    told = subprocess.run(command, capture_output=True, text=True, check=True, timeout=30).stdout
    assert [line.split()[2] for line in told.splitlines()] == ["bowing"] * 2 + ["lunging"] * 2 + ["stretch"] * 2


def test_the_verb_tells_it_and_its_status(kept, tmp_path, capsys):
    records = judged(a_scene(), lots())
    good = kept(records, name="good.mcap").path
    for n, record in enumerate(records):
        if record.key.endswith("/verdict"):
            wrong = record.payload.replace(b"\xa5label\xa6bowing\xaec", b"\xa5label\xa7stretch\xaec")
            records[n] = CaptureRecord("put", record.key, wrong, record.arrived_ns)
    bad = kept(records, name="bad.mcap").path
    assert labanmesh.main(["replay", str(good)]) == 0
    out = capsys.readouterr().out
    assert "3 of 3 verdicts the same bit for bit" in out and out.count("bit for bit\n") == 3
    assert labanmesh.main(["replay", str(bad), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert [row["likeness"] for row in told["verdicts"]] == ["another label", "bit for bit", "bit for bit"]
    assert labanmesh.main(["replay", str(bad), "--without", "wheel"]) == 0
    capsys.readouterr()
    for words in (["none.mcap"], [str(good), "--from", "votes"], [str(good), "--speed", "2"]):
        assert labanmesh.main(["replay", *words]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_a_compressed_chunk_is_never_unpacked(kept, capsys):
    """2.9 GB of zeros in 91 KB: the file of an attacker, whose length says nothing of its contents."""
    path = kept([]).path
    head = path.read_bytes()
    compressor = zstandard.ZstdCompressor(level=1).compressobj()
    zeros = bytes(10_000_000)
    bomb = b"".join(compressor.compress(zeros) for _ in range(290)) + compressor.flush()
    body = struct.pack("<QQQI", 0, 0, 2_900_000_000, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(bomb))
    chunk = b"\x06" + struct.pack("<Q", len(body) + len(bomb)) + body + bomb
    data_end = head.rindex(b"\x0f" + struct.pack("<Q", 4))
    path.write_bytes(head[:data_end] + chunk + head[data_end:])
    for words in (["replay", str(path)], ["replay", str(path), "--from", "posteriors"]):
        assert labanmesh.main(words) == 1
        error = capsys.readouterr().err
        assert "holds chunks, which captures do not have" in error and error.count("\n") == 1
