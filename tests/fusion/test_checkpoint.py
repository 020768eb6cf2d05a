"""A scene outlives a restart: its movement for half a minute, the reliability of its observers for ever."""

import errno
import json
import os

import pytest

from common.config import FusionConfig, ObserverConfig, Scene, read_scene
from common.messages import OngoingMovement, VerdictMessage
from common.vocabulary import Vocabulary
from fusion.checkpoint import FILE_LIMIT, MEMORY_SUFFIX, Checkpoint, CheckpointFile
from fusion.engine.engine import FusionEngine
from fusion.engine.trust import Reliability

NAMES = Vocabulary(("bow", "lunge"))
LEARNED = Reliability("dojo-7", {"cam1": -4.0})


def new_engine():
    return FusionEngine("dojo", ["cam1", "cam2"], NAMES, FusionConfig(id="a"))


@pytest.fixture
def checkpoint():
    judgement = new_engine().step(1000 * 10**9).judgement
    # A restart needs no votes, and the file has none.
    return Checkpoint(judgement=judgement.model_copy(update={"votes": {}}), reliability=LEARNED)


def moved(checkpoint, second, **changed):
    """The checkpoint of a later second of a movement."""
    movement = OngoingMovement(id="dojo-7", began_ns=7)
    judgement = checkpoint.judgement.model_copy(update={"at_ns": second * 10**9, "movement": movement})
    return checkpoint.model_copy(update={"judgement": judgement, **changed})


def verdict_of(checkpoint, label):
    fields = vars(checkpoint.judgement) | {"id": "dojo-7", "began_ns": 7, "decided_ns": 8, "label": label}
    return VerdictMessage.model_validate(fields)


def test_a_verdict_is_unfinished_while_its_own_movement_goes_on(checkpoint):
    verdict = verdict_of(checkpoint, "bow")
    going_on = moved(checkpoint, 1, verdict=verdict)
    assert going_on.unfinished == verdict and checkpoint.model_copy(update={"verdict": verdict}).unfinished is None
    for changed in ({"id": "dojo-8"}, {"ended_ns": 9}):
        assert moved(checkpoint, 1, verdict=verdict.model_copy(update=changed)).unfinished is None


@pytest.fixture
def path(tmp_path, checkpoint):
    CheckpointFile(tmp_path / f"m.a{MEMORY_SUFFIX}").write(checkpoint)
    return tmp_path / f"m.a{MEMORY_SUFFIX}"


def of_one_service(path):
    """The file that one service alone writes, in a folder with those of others."""
    return CheckpointFile(path, "a", "m.")


def test_it_is_read_back_for_its_scene_alone(path, checkpoint):
    assert CheckpointFile(path).read("dojo") == checkpoint
    assert path.stat().st_mode & 0o777 == 0o600, "what a home does is for the service's user alone"
    assert CheckpointFile(path).read("garden") is None
    assert CheckpointFile(path.with_name("none.json")).read("dojo") is None
    assert checkpoint.age_s(1030 * 10**9) == checkpoint.age_s(970 * 10**9) == 30.0


def test_an_engine_with_learned_reliability_states_it_in_its_votes(path):
    engine = new_engine()
    engine.reliability = CheckpointFile(path).read("dojo").reliability
    votes = engine.step(86_400 * 10**9).judgement.votes
    assert votes["cam1"].reliability == votes["cam1"].label_reliability == 0.157 and votes["cam2"].reliability == 1.0


def test_the_file_of_an_earlier_version_is_read(path):
    """It called the reliability "lessons"; so does the handover between services of two versions."""
    text = json.loads(path.read_text())
    assert "lessons" in text and "reliability" not in text
    assert Checkpoint.model_validate_json(json.dumps(text)).reliability == LEARNED
    counted = {**text["lessons"], "right": {"cam1": 1.0}, "claimed": {"cam1": 2.0}}
    assert Checkpoint.model_validate_json(json.dumps({**text, "lessons": counted})).reliability == LEARNED


@pytest.mark.parametrize("spoiled", [{"evidence": {"cam1": 1e3}}, {"evidence": {"cam1": "x"}}, {"evidence": None}])
def test_a_spoiled_file_is_reported_once_and_the_service_starts_afresh(path, spoiled, caplog):
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, "lessons": {**content["lessons"], **spoiled}}))
    file = CheckpointFile(path)
    assert file.read("dojo") is None and file.read("dojo") is None
    assert caplog.text.count("starting afresh") == 1


def test_a_file_that_cannot_be_written_is_reported_once(tmp_path, checkpoint, caplog):
    file = CheckpointFile(tmp_path / "no" / "m.json")
    for second in (1, 2):
        judgement = checkpoint.judgement.model_copy(update={"at_ns": second * 10**9})
        file.write(checkpoint.model_copy(update={"judgement": judgement}))
    assert caplog.text.count("cannot be written: no such file or directory; choose another file or folder") == 1


def test_a_line_is_added_for_what_has_changed_until_the_file_is_long(path, checkpoint):
    file, sizes = of_one_service(path), [0]
    verdict = verdict_of(checkpoint, "bow")
    for second in range(400):
        newest = moved(checkpoint, second, verdict=verdict if second else None)
        file.write(newest)
        assert second % 20 or CheckpointFile(path).read("dojo") == newest
        sizes.append(path.stat().st_size)
    assert max(sizes) < FILE_LIMIT + 1000 and sorted(sizes) != sizes
    assert list(path.parent.iterdir()) == [path]


def test_a_last_line_that_was_cut_off_costs_only_itself(path, checkpoint):
    file, verdict = of_one_service(path), verdict_of(checkpoint, "bow")
    before, newest = moved(checkpoint, 1, verdict=verdict), moved(checkpoint, 2, verdict=verdict)
    file.write(before)
    whole = path.read_bytes()
    file.write(newest)
    for length in range(len(whole), path.stat().st_size - 1):
        cut = path.with_name("cut.json")
        cut.write_bytes(path.read_bytes()[:length])
        assert CheckpointFile(cut).read("dojo") == before
    assert CheckpointFile(path).read("dojo") == newest


@pytest.mark.parametrize(
    ("make", "disturb"),
    [
        (of_one_service, lambda path, other: path.unlink()),
        (CheckpointFile, lambda path, other: path.write_text(other.to_json())),
        (CheckpointFile, lambda path, other: CheckpointFile(path, "other").write(other)),
    ],
)
def test_a_file_that_somebody_else_changed_is_written_whole_again(path, checkpoint, make, disturb):
    """Services on one machine may share a file; each leaves its own newest state."""
    file, verdict = make(path), verdict_of(checkpoint, "bow")
    for second in range(3):
        file.write(moved(checkpoint, second, verdict=verdict))
        disturb(path, moved(checkpoint, second, verdict=verdict_of(checkpoint, "lunge")))
    newest = moved(checkpoint, 3, verdict=verdict)
    file.write(newest)
    assert CheckpointFile(path).read("dojo") == newest


def test_on_a_full_disk_the_last_line_stays_readable(path, checkpoint, caplog, monkeypatch):
    file = of_one_service(path)
    file.write(moved(checkpoint, 1))
    with monkeypatch.context() as full:
        full.setattr("os.write", lambda descriptor, line, write=os.write: write(descriptor, line[:100]))
        full.setattr(
            "fusion.checkpoint.open_private", lambda *_: (_ for _ in ()).throw(OSError(errno.ENOSPC, "No space left"))
        )
        for second in (2, 3):
            file.write(moved(checkpoint, second))
    assert caplog.text.count("cannot be written: no space left") == 1
    assert CheckpointFile(path).read("dojo") == moved(checkpoint, 1)
    file.write(moved(checkpoint, 4))
    assert CheckpointFile(path).read("dojo") == moved(checkpoint, 4)


@pytest.fixture
def scene(tmp_path):
    def read(memory=""):
        text = f'scene = "dojo"\n[observers.cam1]\nsource = "m.npz"\n[fusion]\n{memory}\n'
        (tmp_path / "s.toml").write_text(text)
        return read_scene(tmp_path / "s.toml", {})

    return read


@pytest.mark.parametrize(
    ("memory", "state", "names"),
    [
        ("", "", ["dojo.a.memory.json"]),
        ("", "state", ["state/dojo.a.memory.json"]),
        ('memory = "kept"', "state", ["kept/dojo.a.memory.json"]),
        ('memory = "m.json"', "state", ["m.json"]),
        ('memory = ""', "state", []),
    ],
)
def test_a_service_keeps_its_memory_unless_the_scene_file_wants_none(
    tmp_path, scene, checkpoint, monkeypatch, memory, state, names
):
    for folder in ("state", "kept"):
        (tmp_path / folder).mkdir()
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / state) if state else "")
    file = CheckpointFile.of(scene(memory), "a")
    if file is not None:
        file.write(checkpoint)
    assert [str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*.json")] == names
    if file is not None:
        assert CheckpointFile.of(scene(memory), "a").read("dojo") == checkpoint


def test_a_scene_that_comes_from_no_file_leaves_none_behind():
    assert CheckpointFile.of(Scene(scene="dojo", observers={"cam1": ObserverConfig(source="m.npz")}), "a") is None


def test_the_newest_file_of_all_services_of_a_scene_counts(scene, checkpoint):
    """The standby service was killed first, and starts first."""
    later = checkpoint.judgement.model_copy(update={"at_ns": checkpoint.judgement.at_ns + 10**9})
    newer = checkpoint.model_copy(update={"judgement": later})
    CheckpointFile.of(scene(), "b").write(checkpoint)
    CheckpointFile.of(scene(), "a").write(newer)
    assert CheckpointFile.of(scene(), "b").read("dojo") == newer
