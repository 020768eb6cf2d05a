"""A scene outlives a restart: its movement for half a minute, the reliability of its observers for ever."""

import json

import pytest

from common.config import FusionConfig, ObserverConfig, Scene, read_scene
from common.vocabulary import Vocabulary
from fusion.checkpoint import Checkpoint, CheckpointFile
from fusion.engine.engine import FusionEngine
from fusion.engine.reliability import Reliability

NAMES = Vocabulary(("bow", "lunge"))
LEARNED = Reliability({"cam1": 1.0}, {"cam1": 15.0}, {"cam1 cam2": 12.0}, {"cam1 cam2": 0.1}, "dojo-7")


def new_engine():
    return FusionEngine("dojo", ["cam1", "cam2"], NAMES, FusionConfig(id="a"))


@pytest.fixture
def checkpoint():
    return Checkpoint(judgement=new_engine().step(1000 * 10**9).judgement, reliability=LEARNED)


@pytest.fixture
def path(tmp_path, checkpoint):
    CheckpointFile(tmp_path / "m.json").write(checkpoint)
    return tmp_path / "m.json"


def test_it_is_read_back_for_its_scene_alone(path, checkpoint):
    assert CheckpointFile(path).read("dojo") == checkpoint
    assert CheckpointFile(path).read("garden") is None
    assert CheckpointFile(path.with_name("none.json")).read("dojo") is None
    assert checkpoint.age_s(1030 * 10**9) == checkpoint.age_s(970 * 10**9) == 30.0


def test_an_engine_with_learned_reliability_states_it_in_its_votes(path):
    engine = new_engine()
    engine.reliability = CheckpointFile(path).read("dojo").reliability
    votes = engine.step(86_400 * 10**9).judgement.votes
    assert votes["cam1"].reliability == 0.1 and votes["cam2"].reliability == 1.0
    assert votes["cam1"].doubles == {"cam2": votes["cam2"].doubles["cam1"]}


def test_the_file_of_an_earlier_version_is_read(path):
    """It called the reliability "lessons"; so does the handover between services of two versions."""
    text = json.loads(path.read_text())
    assert "lessons" in text and "reliability" not in text
    assert Checkpoint.model_validate_json(json.dumps(text)).reliability == LEARNED


@pytest.mark.parametrize("spoiled", [{"right": {"cam1": -1}}, {"times": {"cam1": "x"}}, {"distance": None}])
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


def test_pairs_that_are_none_do_no_harm():
    assert Reliability(times={"cam1": 3.0, "": 1.0}).correlations("cam1") == {}
