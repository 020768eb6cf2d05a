"""What was learned of the judges outlives a restart, however long the service was away; a spoiled file does no harm."""

import json

import pytest

from common.config import FusionConfig
from common.vocabulary import Vocabulary
from fusion.engine.engine import FusionEngine
from fusion.engine.reliability import Reliability
from fusion.memory_file import Memory

NAMES = Vocabulary(("bow", "lunge"))
DAY_NS = 86_400 * 10**9
LEARNED = Reliability({"cam1": 1.0}, {"cam1": 15.0}, {"cam1 cam2": 12.0}, {"cam1 cam2": 0.1}, "dojo-7")


@pytest.fixture
def kept(tmp_path):
    memory = Memory(tmp_path / "m.json")
    judgement = FusionEngine("dojo", ["cam1", "cam2"], NAMES, FusionConfig(id="a")).step(1000 * 10**9).judgement
    memory.keep(judgement, None, LEARNED)
    return tmp_path / "m.json"


def test_lessons_are_recalled_after_days_and_for_their_scene_alone(kept):
    assert Memory(kept).recall("dojo", DAY_NS * 9) is None
    assert Memory(kept).lessons("dojo") == LEARNED
    assert Memory(kept).lessons("garden") == Reliability()


def test_a_referee_that_is_given_them_says_so_in_its_votes(kept):
    referee = FusionEngine("dojo", ["cam1", "cam2"], NAMES, FusionConfig(id="a"))
    referee.reliability = Memory(kept).lessons("dojo")
    votes = referee.step(DAY_NS).judgement.votes
    assert votes["cam1"].reliability == 0.1 and votes["cam2"].reliability == 1.0
    assert votes["cam1"].doubles == {"cam2": votes["cam2"].doubles["cam1"]}


@pytest.mark.parametrize("spoiled", [{"right": {"cam1": -1}}, {"times": {"cam1": "x"}}, {"distance": None}])
def test_a_spoiled_file_is_told_once_and_begun_afresh(kept, spoiled, caplog):
    said = json.loads(kept.read_text())
    kept.write_text(json.dumps({**said, "lessons": {**said["lessons"], **spoiled}}))
    memory = Memory(kept)
    assert memory.lessons("dojo") == Reliability() and memory.recall("dojo", 0) is None
    assert caplog.text.count("beginning afresh") == 1


def test_pairs_that_are_none_do_no_harm():
    assert Reliability(times={"cam1": 3.0, "": 1.0}).correlations("cam1") == {}
