"""Two processes of one id: of two fusion services one ends, of two observers one counts and both are reported."""

import time

import pytest
from attack_storm import aftermath, settle
from fault_processes import Process, labanmesh
from fault_stage import SECOND_NS, VIEWS, Replay, Stage, all_count, counted
from mesh_stage import until

ROUNDS = 20
NOTICED_S = 3.0
RUN_S = 2.0
"""How long the survivor goes on before the next round."""


@pytest.fixture(scope="module")
def replay(tmp_path_factory):
    return Replay(tmp_path_factory.mktemp("replay"))


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
