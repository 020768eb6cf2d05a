"""Processes that stop for seconds and go on, as a swapping machine or a suspended container lets them."""

import time

import pytest
from fault_stage import LONG, LONG_FORM, SECOND_NS, SERVICES, all_count, judged, longest_gap_s

FROZEN_S = 5.0 if LONG else 2.0
KINDS = ("leader", *(pytest.param(kind, marks=LONG_FORM) for kind in ("standby", "observer", "hub", "router")))


@pytest.mark.parametrize("kind", KINDS)
def test_a_process_that_freezes_for_seconds_loses_and_doubles_no_verdict(team, long_form, kind):
    witness = team.witness()
    witness.wait_for(all_count, why="all count")
    leads = witness.last["fusion"]
    others = {"leader": leads, "standby": next(one for one in SERVICES if one != leads), "observer": "wheel"}
    process = team.processes[others.get(kind, kind)]
    frozen_ns, before_s = time.time_ns(), team.waited_s()
    process.freeze()
    if kind == "router":
        time.sleep(FROZEN_S)  # no message arrives meanwhile: there is no other condition than time
    else:
        witness.wait_for(lambda w: w.last["at_ns"] - frozen_ns > FROZEN_S * SECOND_NS, why="judgements go on")
    process.thaw()
    thawed_ns = time.time_ns()
    witness.wait_for(lambda w: w.last["arrived_ns"] > thawed_ns and all_count(w), why="all count again")
    back_s = (witness.last["arrived_ns"] - thawed_ns) / SECOND_NS
    gap_s = longest_gap_s([one["at_ns"] for one in witness.judgements if one["at_ns"] > frozen_ns - SECOND_NS])
    print(f"{kind} frozen: longest gap between judgements {gap_s:.2f} s, all count {back_s:.2f} s after its return")
    # What processes wait for a processor of a busy machine is not the mesh's time.
    assert gap_s < 1.0 + team.waited_s() - before_s or kind == "router"
    # A movement while the router is frozen has no verdict; the ones after it have.
    since_ns = thawed_ns + SECOND_NS if kind == "router" else frozen_ns
    judged(team, witness, movements=4 if long_form else 1, since_ns=since_ns)
