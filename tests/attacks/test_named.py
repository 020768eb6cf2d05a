"""Who misbehaves is named: in watch, on the page, by the doctor and in the metrics."""

import io

import pytest
from attack_person import scripted
from attack_strategies import HONEST, STRATEGIES
from attack_trial import BEGAN_NS, HOSTILE, Case, run
from rich.console import Console

from common.config import ObserverConfig, Scene
from common.message_types import CONTRADICTED
from common.messages import StatusMessage
from common.wire import encode
from deploy.doctor.mesh import ExpectedMesh, check_mesh
from deploy.doctor.traffic import MeshTraffic
from fusion.metrics import FusionMetrics
from hub.dashboard.history import SceneHistory
from hub.dashboard.page_data import state_data
from hub.scene_state import SceneState
from hub.terminal import render

PLACES = ("watch", "page", "doctor", "metrics")
LIES = tuple(name for name in STRATEGIES if name != HONEST)
IN_SHORT = ("wrong from the first frame", "rest inverted")


@pytest.fixture(scope="module")
def names():
    """What each of the four shows of the hostile judge, and of an honest one, after the same lies."""

    def shown(strategy):
        outcome = run(scripted(movements=4), Case(strategy, 4, 10))
        scene = Scene(scene="dojo", observers={name: ObserverConfig(source="x") for name in outcome.judgement.votes})
        status = StatusMessage(scene="dojo", id="fusion", state="running", observers=outcome.statistics)
        state = SceneState("dojo", scene.roster).fold(outcome.judgement, BEGAN_NS).fold(status, BEGAN_NS, "fusion")
        for name in scene.roster:
            state = state.fold(StatusMessage(scene="dojo", id=name, state="running"), BEGAN_NS)
        traffic = MeshTraffic(scene.keys, alive_observers=frozenset(scene.roster))
        traffic.record(scene.keys.judgement, encode(outcome.judgement), BEGAN_NS)
        traffic.record(scene.keys.fusion_status("fusion"), encode(status), BEGAN_NS)
        return {
            "watch": watched(state),
            "page": {each["name"] for each in state_data(SceneHistory(state))["observers"] if is_marked(each)},
            "doctor": doubted(scene, traffic),
            "metrics": measured(outcome, status),
        }

    return shown


def watched(state):
    """The observers in whose rows watch has something to say; the row goes on below the name."""
    file, named, name = io.StringIO(), set(), ""
    Console(file=file, width=90).print(render(state, 60))
    for line in file.getvalue().splitlines():
        name = next((each for each in state.roster if f" {each} " in line), name)
        if "contradict" in line or "bad message" in line:
            named.add(name)
    return named


def is_marked(observer):
    return observer["rejected"] > 0 or observer["contradicted"] is not None or observer["rest_contradicted"] is not None


def doubted(scene, traffic):
    findings = check_mesh(ExpectedMesh(scene, "", "s.toml"), traffic)
    texts = [finding.what for finding in findings if "contradict" in finding.what or "rejected" in finding.what]
    return {name for name in scene.roster for text in texts if text.startswith(name)}


def measured(outcome, status):
    metrics = FusionMetrics("fusion", None)
    samples = [*metrics._of(outcome.judgement), *metrics._rejected(status, outcome.judgement)]
    rows = [sample for metric in samples for sample in metric.samples]
    low = {
        row.labels["observer"]
        for row in rows
        if (row.name.endswith("_reliability_ratio") and row.value < 0.6)
        or (row.name.endswith("posteriors_rejected_total") and row.value > 0)
    }
    return low & set(outcome.judgement.votes)


@pytest.mark.parametrize("strategy", LIES)
def test_a_hostile_judge_is_named_and_no_honest_one(names, strategy, long_form):
    if not long_form and strategy not in IN_SHORT:
        pytest.skip("in the long form: make attacks")
    assert names(strategy) == {place: {HOSTILE} for place in PLACES}


def test_nobody_is_named_where_all_are_honest(names, long_form):
    if not long_form:
        pytest.skip("in the long form: make attacks")
    assert names(HONEST) == {place: set() for place in PLACES}


@pytest.mark.parametrize("all_slow", [False, True], ids=["alone", "all"])
@pytest.mark.parametrize("rate_hz", [0.5, 1, 2, 4, 30])
def test_an_honest_judge_that_publishes_seldom_is_not_named_at_any_moment(person, rate_hz, all_slow, long_form):
    if not long_form:
        pytest.skip("in the long form: make attacks")
    for judges in (2, 3, 4):
        case = Case(HONEST, judges, rate_hz if all_slow else 15, slow_hz=rate_hz)
        outcome = run(person, case)
        assert all(least >= CONTRADICTED for least in outcome.about_rest.values()), (case, outcome.about_rest)
