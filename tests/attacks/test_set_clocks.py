"""The clock of the fusion machine is set within a movement, in real processes: no verdict is lost, doubled or turned.
Observers and listener are on other machines. The rules alone: tests/fusion/test_set_clock.py."""

import signal
from itertools import accumulate

import pytest
from attack_storm import aftermath
from fault_stage import SECOND_NS, Replay, Stage, all_count

JUMPS_S = (-3600.0, -0.5, -0.05, 3.0, 3600.0)


def moving(judgement, *, decided):
    movement = judgement.get("movement")
    return movement is not None and (movement["label"] is not None) == decided


def by_true_time(verdict):
    """A verdict with its times by the listener's clock; the service stamps by the clock that it had at rest."""
    off_ns = verdict["arrived_ns"] - verdict["at_ns"]
    names = ("began_ns", "decided_ns", "ended_ns")
    return {**verdict, **{name: verdict[name] and verdict[name] + off_ns for name in names}}


@pytest.mark.parametrize("decided", [False, True], ids=["before the decision", "after the decision"])
def test_a_fusion_clock_that_is_set_loses_and_doubles_no_verdict(
    tmp_path, tmp_path_factory, long_form, history, decided
):
    if not long_form:
        pytest.skip("the long form: make attacks")
    replay = Replay(tmp_path_factory)
    with Stage(replay, tmp_path) as stage:
        stage.with_clock("fusion", 0.0, *accumulate(JUMPS_S))
        stage.play()
        witness = stage.witness()
        witness.wait_for(all_count, why="all count")
        since_ns = witness.last["arrived_ns"]
        for jump_s in JUMPS_S:
            ended = len({v["id"] for v in witness.verdicts if v["ended_ns"]})
            witness.wait_for(lambda w: moving(w.last, decided=decided), why="a movement")
            stage.processes["fusion"].send(signal.SIGUSR1)
            history.note("set", by_s=jump_s, movement=witness.last["movement"])
            # The movement, and the next one by the clock that was taken over at rest.
            witness.wait_for(lambda w, n=ended + 2: len({v["id"] for v in w.verdicts if v["ended_ns"]}) >= n)
            off_s = (witness.last["at_ns"] - witness.last["arrived_ns"]) / SECOND_NS
            history.note("after", off_s=off_s)
        final_ns = witness.last["arrived_ns"]
        witness.wait_for(lambda w: w.last["arrived_ns"] > final_ns + 3 * SECOND_NS, why="judgements go on")
        performed = replay.performed(stage.start_ns, since_ns, final_ns)
        judgements = [{**one, "at_ns": one["arrived_ns"]} for one in witness.judgements]
        result = aftermath(performed, judgements, [by_true_time(v) for v in witness.verdicts])
        history.note("end", result=str(result), detail=vars(result))
        print(result)
        assert abs(off_s - sum(JUMPS_S)) < 0.2
        assert result.harmless and not result.unheard, f"{vars(result)}\n{stage.logs()}"
