"""A movement that nobody could hear is counted; checkpoints of movements that are over end them."""

import pytest

from common.config import FusionConfig
from common.messages import OngoingMovement
from common.vocabulary import Vocabulary
from fusion.engine.engine import EngineOutput, FusionEngine
from fusion.instrumentation import ServerStep
from fusion.metrics import FusionMetrics
from fusion.scene_worker import StepResult

UNDECIDED = {"one": OngoingMovement(id="one", began_ns=1), "two": OngoingMovement(id="two", began_ns=2)}
DECIDED = {f"{name} decided": m.model_copy(update={"label": "bow", "decided_ns": 3}) for name, m in UNDECIDED.items()}
MOVEMENTS = {"": None, **UNDECIDED, **DECIDED}


@pytest.mark.parametrize(
    ("course", "unheard"),
    [
        (["", "one", "one", "two", "two decided"], 1),
        (["one", "one decided", "two"], 0),
        (["one", "", "two"], 0),
        (["", "one", "", ""], 0),
    ],
)
def test_a_movement_that_began_and_gave_way_to_another_without_a_verdict_was_unheard(course, unheard):
    metrics = FusionMetrics("fusion", None)
    judgement = FusionEngine("dojo", ["cam1"], Vocabulary(("bow", "lunge")), FusionConfig()).step(10**18).judgement
    for name in course:
        output = EngineOutput(judgement.model_copy(update={"movement": MOVEMENTS[name], "epoch": 1}), ())
        metrics.record(ServerStep([StepResult(output)], 1, 0, 0, 0, 0.0))
    identity = {"fusion": "fusion"}
    assert metrics.registry.get_sample_value("labanmesh_movements_unheard_total", identity) == unheard
