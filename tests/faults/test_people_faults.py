"""Two SIMULATED people, whose movements are known to the frame: services die, a network splits, a judge lies."""

import random
import time

import pytest
from fault_people import CYCLE_NS, LIES, OBSERVERS, PEOPLE
from fault_people_stage import PeopleStage, both_count, of, performed
from fault_stage import SECOND_NS, SETTLE_S, tally

KILLS, MOST_KILLS = 1, 12
"""In the short form and in the long one."""


def require_right(stage, witness, since_ns):
    """Each movement of each person since then, of each at least one, has one right verdict that ended."""
    until_ns = max(time.time_ns(), since_ns + 2 * CYCLE_NS)
    witness.wait_for(lambda w: w.last["at_ns"] > until_ns + SETTLE_S * SECOND_NS, why="the last movement is judged")
    results = {person: tally(performed(person, since_ns, until_ns), of(person, witness.verdicts)) for person in PEOPLE}
    faults = {person: result.faults for person, result in results.items() if result.faults}
    received = [(v["person"], v["id"], v["label"], v["stage"], v["fusion"]) for v in witness.verdicts]
    assert not faults, f"{faults}\n{received}\n{stage.logs()}"
    assert all(result.complete and result.performed for result in results.values())


def owner(witness):
    witness.look()
    return witness.last["fusion"]


@pytest.mark.parametrize("secured", [False, True])
def test_a_killed_service_costs_neither_of_two_people_a_verdict(tmp_path, long_form, secured):
    if not (long_form or secured):
        pytest.skip("the long form: make faults")
    chance = random.Random(11)  # noqa: S311 - to be repeated
    with PeopleStage(tmp_path, secured=secured) as stage:
        stage.play()
        witness = stage.witness()
        witness.wait_for(both_count, why="all count")
        since_ns = time.time_ns()
        for _ in range(MOST_KILLS if long_form else KILLS):
            victim, due_ns = owner(witness), time.time_ns() + chance.randrange(CYCLE_NS)
            witness.wait_for(lambda w, due_ns=due_ns: w.last["at_ns"] > due_ns, why="a moment of a movement")
            stage.processes[victim].kill()
            stage.processes[victim].start()
            started_ns = time.time_ns()
            witness.wait_for(
                lambda w, name=victim, at_ns=started_ns: any(
                    s["id"] == name and s["at_ns"] > at_ns and "standing by for" in s["reason"] for s in w.statuses
                ),
                why=f"{victim} stands by",
            )
        require_right(stage, witness, since_ns)


@pytest.mark.parametrize("lie", LIES)
def test_a_lying_judge_costs_neither_of_two_people_a_verdict(tmp_path, long_form, lie):
    if not long_form:
        pytest.skip("the long form: make faults; tests/integration/test_people.py has one")
    with PeopleStage(tmp_path, lie=lie) as stage:
        stage.play()
        witness = stage.witness()
        witness.wait_for(lambda w: both_count(w, OBSERVERS[:2]), why="the honest ones count")
        since_ns = time.time_ns()
        until_ns = since_ns + 6 * CYCLE_NS
        witness.wait_for(lambda w: w.last["at_ns"] > until_ns, why="some movements")
        require_right(stage, witness, since_ns)
