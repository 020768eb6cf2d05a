"""Two processes of one id: of two fusion services one ends, of two observers one counts and both are reported."""

import time

import pytest
from attack_storm import aftermath, settle
from fault_processes import Process
from fault_slow_line import SlowLine
from fault_stage import SECOND_NS, SETTLE_S, VIEWS, Replay, Stage, all_count, counted
from processes import labanmesh, until
from test_split import far_router

from benchmarks.timing import free_port
from common.message_types import SAME_ID_REASON

ROUNDS = 20
NOTICED_S = 3.0
APART_S = 8.0
"""Longer than a service is young."""
RUN_S = 2.0
"""How long the survivor goes on before the next round."""


@pytest.fixture(scope="module")
def replay(tmp_path_factory):
    return Replay(tmp_path_factory)


def test_of_two_fusion_services_of_one_id_that_start_together_one_ends(request, tmp_path, long_form, history):
    if not long_form:
        pytest.skip("the long form: make attacks")
    with Stage(request.getfixturevalue("replay"), tmp_path) as stage:
        stage.processes["twin"] = Process(labanmesh("fuse", stage.file))
        twins = [stage.processes["fusion"], stage.processes["twin"]]
        stage.play()
        witness, noticed_s = stage.witness(), []
        witness.wait_for(all_count, why="all count")
        for number in range(ROUNDS):
            # Until one has ended there may be no judgement: each waits whether the other is a dead one's token.
            for twin in twins:
                twin.kill()
            begun_s = time.monotonic()
            for twin in twins:
                twin.start()
            published(witness, time.time_ns())
            published_s = time.monotonic()
            until(lambda: sum(twin.running for twin in twins) == 1)
            noticed_s.append(time.monotonic() - published_s)
            history.note("round", number=number, noticed_s=noticed_s[-1], after_s=time.monotonic() - begun_s)
            alone_ns = time.time_ns()
            published(witness, alone_ns + RUN_S * SECOND_NS)
            sessions = {one["session"] for one in witness.judgements if one["at_ns"] > alone_ns + SECOND_NS // 2}
            assert len(sessions) == 1, sessions
        result = aftermath(settle(stage, witness)[1:], witness.judgements, witness.verdicts)
        history.note("end", result=str(result), detail=vars(result))
        print(f"noticed within {max(noticed_s):.2f} s of the first judgement; {result}")
        assert max(noticed_s) < NOTICED_S
        assert not (result.doubled or result.wrong), vars(result)


def published(witness, at_ns):
    """Wait for a judgement made after this time."""
    witness.wait_for(lambda w: w.last["at_ns"] > at_ns, why="one of them publishes")


def test_of_two_fusion_services_of_one_id_that_meet_after_a_partition_one_stands_by(
    request, tmp_path, long_form, history
):
    if not long_form:
        pytest.skip("the long form: make attacks")
    port = free_port()
    with (
        Stage(request.getfixturevalue("replay"), tmp_path, extra="quorum = 1") as stage,
        SlowLine(stage.port, 0.0) as line,
    ):
        far_file = stage.write("far.toml", f"tcp/127.0.0.1:{port}", extra="quorum = 1")
        stage.processes["far router"] = far_router(tmp_path, port, line.port)
        line.cut()
        stage.processes["wheel"] = Process(labanmesh("observe", far_file, "wheel"))
        stage.processes["twin"] = Process(labanmesh("fuse", far_file))
        stage.play()
        near, far = stage.witness(), stage.witness(scene_file=far_file)
        near.wait_for(lambda w: counted(w.last, "door", "corner"), why="the near half is judged")
        far.wait_for(lambda w: counted(w.last, "wheel"), why="the far half is judged")
        since_ns = time.time_ns()
        near.wait_for(lambda w: w.last["at_ns"] > since_ns + APART_S * SECOND_NS, why="both are old")
        line.heal()
        healed_ns = time.time_ns()
        near.wait_for(all_count, why="one network")
        joined_ns = near.last["arrived_ns"]
        near.wait_for(lambda w: w.last["at_ns"] > healed_ns + 12 * SECOND_NS, why="movements together")
        far.look()
        until_ns = near.last["at_ns"] - round(2 * SETTLE_S * SECOND_NS)
        movements = stage.replay.performed(stage.start_ns, since_ns, until_ns)
        for name, witness in (("near", near), ("far", far)):
            late = [one for one in witness.judgements if one["arrived_ns"] > joined_ns + NOTICED_S * SECOND_NS]
            assert len({one["session"] for one in late}) == 1, name
            result = aftermath(movements, witness.judgements, witness.verdicts)
            history.note(name, result=str(result), detail=vars(result))
            print(name, result)
            assert not (result.doubled or result.unended or result.wrong), f"{vars(result)}\n{stage.logs()}"
        assert stage.processes["fusion"].running and stage.processes["twin"].running
        reasons = {one["reason"] for one in near.statuses if one["id"] == "fusion"}
        assert SAME_ID_REASON in reasons, reasons


def test_two_observers_of_one_id_are_reported_and_one_counts(request, tmp_path, long_form, history):
    if not long_form:
        pytest.skip("the long form: make attacks")
    with Stage(request.getfixturevalue("replay"), tmp_path) as stage:
        stage.processes["twin"] = Process(labanmesh("observe", stage.file, "wheel"))
        stage.play()
        witness = stage.witness()
        witness.wait_for(lambda w: counted(w.last, *VIEWS), why="all count")

        def reported(witness):
            statuses = [s for s in witness.statuses if s["id"] == "fusion" and s["observers"]]
            return statuses and statuses[-1]["observers"]["wheel"]["rejected"].get("same_id", 0) > 1

        begun_s = time.monotonic()
        witness.wait_for(reported, timeout_s=NOTICED_S, why="the fusion service reports two of one id")
        history.note("reported", after_s=time.monotonic() - begun_s)
        assert counted(witness.last, *VIEWS)
