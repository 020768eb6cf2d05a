"""A network in two halves for fifteen seconds, each with a router, a fusion service, observers and hubs."""

import json
import time
from contextlib import ExitStack

import pytest
from attack_listeners import listeners
from attack_storm import aftermath
from fault_people import CYCLE_NS, PEOPLE
from fault_people_stage import PeopleStage, both_count, of, performed
from fault_processes import Process
from fault_slow_line import SlowLine
from fault_stage import SCENE, SECOND_NS, SERVICES, SETTLE_S, Replay, Stage, all_count
from processes import labanmesh

from benchmarks.timing import free_port
from deploy.security.routing import plain_rules

SPLIT_S = 15.0
ONE_LEADER_S = 2.0
FAR = (SERVICES[1], "wheel")
"""What is on the other side."""


def far_router(folder, port, line_port):
    """The command of a router that listens at `port` and reaches the other one over the line."""
    settings = json.loads(plain_rules(f"tcp/127.0.0.1:{port}").make())
    retry = {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 2}
    settings["connect"] = {"endpoints": [f"tcp/127.0.0.1:{line_port}"], "exit_on_failure": False, "retry": retry}
    place = folder / "far_router.json5"
    place.write_text(json.dumps(settings))
    return Process(labanmesh("router", "--config", place))


def leader(witness, since_ns):
    """The service whose judgements have arrived alone since then; None without a judgement."""
    witness.look()
    names = {one["fusion"] for one in witness.judgements if one["arrived_ns"] > since_ns}
    return names.pop() if len(names) == 1 else None


@pytest.mark.parametrize("seed_s", [0.0, 0.7, 1.4])
def test_after_a_split_there_is_one_leader_and_one_verdict_a_movement_for_every_listener(
    tmp_path, tmp_path_factory, long_form, history, seed_s
):
    if not long_form:
        pytest.skip("the long form: make attacks")
    replay, port = Replay(tmp_path_factory), free_port()
    with (
        Stage(replay, tmp_path, fusions=SERVICES, extra="quorum = 1") as stage,
        SlowLine(stage.port, 0.0) as line,
        ExitStack() as hubs,
    ):
        far_file = str(stage.write("far.toml", f"tcp/127.0.0.1:{port}", SERVICES, "quorum = 1"))
        for name in FAR:
            command = stage.processes[name].command
            command[command.index(str(stage.file))] = far_file
        stage.processes["far router"] = far_router(tmp_path, port, line.port)
        stage.play()
        near, far = stage.witness(), stage.witness(scene_file=far_file)
        for witness in (near, far):
            witness.wait_for(all_count, why="all count")
        others = {}
        for side, file in (("near", stage.file), ("far", far_file)):
            for kind, hub in listeners(file, tmp_path / f"{side} broker", SCENE).items():
                hubs.callback(hub.close)
                others[f"{side} {kind}"] = hub.open()
        # Listeners take seconds to start on a busy machine; before that they hear nothing.
        since_ns = time.time_ns()
        history.note("cut")
        line.cut()
        cut_ns = time.time_ns()
        far.wait_for(lambda w: w.last["fusion"] == SERVICES[1], why="the other half has a leader of its own")
        until_ns = cut_ns + round((SPLIT_S + seed_s) * SECOND_NS)
        near.wait_for(lambda w: w.last["at_ns"] > until_ns, why="the split lasts")
        history.note("heal")
        line.heal()
        healed_ns = time.time_ns()
        near.wait_for(lambda w: w.last["at_ns"] > healed_ns + 12 * SECOND_NS, why="movements after the split")
        far.look()
        movements = replay.performed(stage.start_ns, since_ns, near.last["at_ns"] - round(2 * SETTLE_S * SECOND_NS))
        results = {}
        for name, hub in {"near": near, "far": far, **others}.items():
            judgements = (near if name.startswith("near") else far).judgements
            results[name] = result = aftermath(movements, judgements, hub.verdicts)
            history.note(name, result=str(result), detail=vars(result))
            print(name, result)
        harmed = {name: vars(each) for name, each in results.items() if each.doubled or each.unended or each.wrong}
        if harmed:
            history.keep_more("messages.json", json.dumps({"near": near.messages, "far": far.messages}))
        assert not harmed, f"{harmed}\n{stage.logs()}"
        joined_ns = next(
            one["arrived_ns"] for one in far.judgements if one["arrived_ns"] > healed_ns and all_joined(one)
        )
        history.note("joined", after_s=(joined_ns - healed_ns) / SECOND_NS)
        print(f"one network after {(joined_ns - healed_ns) / SECOND_NS:.2f} s")
        settled_ns = joined_ns + round(ONE_LEADER_S * SECOND_NS)
        assert leader(near, settled_ns) == leader(far, settled_ns) is not None


def all_joined(judgement):
    """Whether observers of both halves count."""
    return all(judgement["votes"][name]["state"] == "counted" for name in ("door", "wheel"))


def test_after_a_split_each_movement_of_two_people_has_one_verdict_that_ended(tmp_path, long_form):
    """SIMULATED people; at a listener in each half."""
    port = free_port()
    with PeopleStage(tmp_path, extra="quorum = 1") as stage, SlowLine(stage.port, 0.0) as line:
        far_file = stage.write("far.toml", f"tcp/127.0.0.1:{port}", "quorum = 1")
        stage.processes[SERVICES[1]] = stage.service(SERVICES[1], far_file)
        stage.processes["wheel"] = stage.observer("wheel", far_file)
        stage.processes["far router"] = far_router(tmp_path, port, line.port)
        stage.play()
        near, far = stage.witness(), stage.witness(scene_file=far_file)
        for witness in (near, far):
            witness.wait_for(both_count, why="all count")
        since_ns = time.time_ns()
        line.cut()
        far.wait_for(lambda w: w.last["fusion"] == SERVICES[1], why="the other half has an owner of its own")
        until_ns = time.time_ns() + (6 if long_form else 1) * CYCLE_NS
        near.wait_for(lambda w: w.last["at_ns"] > until_ns, why="the split lasts")
        line.heal()
        healed_ns = time.time_ns()
        near.wait_for(lambda w: w.last["at_ns"] > healed_ns + 2 * CYCLE_NS, why="movements after the split")
        far.look()
        settled_ns = near.last["at_ns"] - round(2 * SETTLE_S * SECOND_NS)
        for name, witness in {"near": near, "far": far}.items():
            for person in PEOPLE:
                movements = performed(person, since_ns, settled_ns)
                result = aftermath(movements, of(person, witness.judgements), of(person, witness.verdicts))
                print(name, person, result)
                assert result.harmless and result.right, f"{name}, {person}: {vars(result)}\n{stage.logs()}"
        one_ns = healed_ns + round(ONE_LEADER_S * SECOND_NS)
        assert leader(near, one_ns) == leader(far, one_ns) is not None
