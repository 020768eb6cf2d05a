"""Storms of kills and freezes: no verdict is wrong or doubled, each ends, and none is lost that anybody could hear.
LABANMESH_STORM_S seconds each, 60 by default; LABANMESH_STORMS: how many seeds from LABANMESH_ATTACKS_SEED on.
LABANMESH_STORM_SCENES: 1, or 1,20 for both; LABANMESH_STORM_MESHES: plain, or plain,secured."""

import json
import os
import random

import pytest
from attack_fleet import Fleet, LinkedFleet
from attack_history import SEED, History
from attack_storm import KINDS, Aftermath, aftermath, settle, storm, storm_of_links
from fault_people import CYCLE_NS, PEOPLE
from fault_people_stage import PeopleStage, both_count, of, performed
from fault_stage import SECOND_NS, Movement, Replay, all_count

from common.text import plural

STORM_S = float(os.environ.get("LABANMESH_STORM_S", "60"))
SEEDS = range(
    int(os.environ.get(SEED, "17")), int(os.environ.get(SEED, "17")) + int(os.environ.get("LABANMESH_STORMS", "1"))
)
SCENES = [int(word) for word in os.environ.get("LABANMESH_STORM_SCENES", "1").split(",")]
MESHES = os.environ.get("LABANMESH_STORM_MESHES", "plain").split(",")


@pytest.fixture(scope="module")
def replay(tmp_path_factory):
    return Replay(tmp_path_factory)


def all_scenes_count(fleet):
    """Whether the votes of all observers count in every scene, for a witness."""

    def holds(witness):
        others = [witness.others.get(name, {}).get("judgement") or [] for name in fleet.scenes[1:]]
        return all_count(witness) and all(
            each and all(vote["state"] == "counted" for vote in each[-1]["votes"].values()) for each in others
        )

    return holds


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scenes", SCENES)
@pytest.mark.parametrize("mesh", MESHES)
def test_after_a_storm_each_movement_that_was_heard_has_one_right_verdict_that_ended(
    mesh, scenes, kind, seed, request, long_form, tmp_path
):
    if not long_form:
        pytest.skip("the long form: make attacks")
    replay, history = request.getfixturevalue("replay"), History(request.node.nodeid, seed)
    chance = random.Random(seed)  # noqa: S311 - to be repeated
    with Fleet(replay, tmp_path, scenes=scenes, secured=mesh == "secured") as stage:
        stage.play()
        witness = stage.witness()
        witness.wait_for(all_scenes_count(stage), why=f"all count\n{stage.logs()}")
        since_ns = witness.last["at_ns"]
        storm(stage, kind, STORM_S, chance, history)
        # A busy machine needs seconds to start what was killed last, which then ends what was decided before.
        witness.wait_for(all_scenes_count(stage), why=f"all count again\n{stage.logs()}")
        performed = [one for one in settle(stage, witness) if one.began_ns > since_ns]
        results = {}
        for name in stage.scenes:
            of = witness.others.get(name, witness.messages)
            results[name] = aftermath(performed, of["judgement"], of["verdict"])
            words = [(v["id"], v["label"], v["stage"], v["arrived_ns"]) for v in of["verdict"]]
            history.note("end", scene=name, result=str(results[name]), detail=vars(results[name]), verdicts=words)
        path, harmed = history.keep(), {name: each for name, each in results.items() if not each.harmless}
        if harmed:
            messages = {name: witness.others.get(name, witness.messages) for name in harmed}
            history.keep_more("messages.json", json.dumps(messages))
            history.keep_more("logs", stage.logs(most=None))
        print(f"{kind}, seed {seed}, {mesh}: {sum(results.values(), Aftermath(0))} in {plural(scenes, 'scene')}")
        harm = "\n".join(f"{name}: {vars(each)}" for name, each in harmed.items())
        assert not harmed, f"{harm}\n{path}\n{stage.logs()}"


@pytest.mark.parametrize("seed", SEEDS)
def test_after_a_storm_of_links_each_movement_has_one_right_verdict_for_every_listener(
    seed, request, long_form, tmp_path
):
    if not long_form:
        pytest.skip("the long form: make attacks")
    replay, history = request.getfixturevalue("replay"), History(request.node.nodeid, seed)
    chance = random.Random(seed)  # noqa: S311 - to be repeated
    with LinkedFleet(replay, tmp_path) as stage:
        stage.play()
        witness = stage.witness()
        witness.wait_for(all_count, why=f"all count\n{stage.logs()}")
        others = stage.open_listeners()
        witness.look()
        since_ns = witness.last["at_ns"]
        storm_of_links(stage, STORM_S, chance, history)
        witness.wait_for(all_count, why=f"all count again\n{stage.logs()}")
        performed = [one for one in settle(stage, witness) if one.began_ns > since_ns]
        others["watch"].look()
        results = {}
        for name, listener in {"witness": witness, **others}.items():
            results[name] = aftermath(performed, witness.judgements, listener.verdicts)
            words = [(v["id"], v["label"], v["stage"], v["began_ns"], v["ended_ns"]) for v in listener.verdicts]
            history.note("end", listener=name, result=str(results[name]), detail=vars(results[name]), verdicts=words)
            print(f"links, seed {seed}, {name}: {results[name]}")
        harmed = {name: vars(each) for name, each in results.items() if not each.harmless}
        path = history.keep()
        if harmed:
            history.keep_more("messages.json", json.dumps(witness.messages))
            history.keep_more("logs", stage.logs(most=None))
        assert not harmed, f"{harmed}\n{path}\n{stage.logs()}"


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", ["both fusions", "router", "all"])
def test_after_a_storm_each_movement_of_two_people_has_one_right_verdict_that_ended(
    kind, seed, request, long_form, tmp_path
):
    if not long_form:
        pytest.skip("the long form: make attacks")
    history = History(request.node.nodeid, seed)
    chance = random.Random(seed)  # noqa: S311 - to be repeated
    with PeopleStage(tmp_path) as stage:
        stage.play()
        witness = stage.witness()
        witness.wait_for(both_count, why="all count")
        since_ns = witness.last["at_ns"]
        storm(stage, kind, STORM_S, chance, history)
        witness.wait_for(both_count, why="all count again")
        until_ns = witness.last["at_ns"]
        witness.wait_for(lambda w: w.last["at_ns"] > until_ns + CYCLE_NS, why="the last movements are judged")
        results = {}
        for person in PEOPLE:
            judgements, verdicts = of(person, witness.judgements), of(person, witness.verdicts)
            results[person] = aftermath(performed(person, since_ns, until_ns), judgements, verdicts)
            words = [(v["id"], v["label"], v["stage"], v["began_ns"], v["ended_ns"]) for v in verdicts]
            history.note("end", person=person, detail=vars(results[person]), verdicts=words)
            print(f"two people, {kind}, seed {seed}, {person}: {results[person]}")
        path, harmed = history.keep(), {name: vars(each) for name, each in results.items() if not each.harmless}
        if harmed:
            history.keep_more("messages.json", json.dumps(witness.messages))
            history.keep_more("logs", "\n".join(process.log for process in stage.processes.values()))
        assert not harmed, f"{harmed}\n{path}\n{stage.logs()}"


def judged(at_s, heard=2):
    at_ns = int(at_s * SECOND_NS)
    return {"at_ns": at_ns, "arrived_ns": at_ns, "movement": None, "agreement": {"n": heard}}


def word(name, label, began_s, ended_s=None, of="", **fields):
    end_ns = None if ended_s is None else int(ended_s * SECOND_NS)
    times = {"began_ns": int(began_s * SECOND_NS), "decided_ns": int((began_s + 0.5) * SECOND_NS), "ended_ns": end_ns}
    if of:
        at_ns = end_ns or times["decided_ns"]
        fields |= {"fusion": of, "session": "", "at_ns": at_ns, "arrived_ns": at_ns}
    return {"id": name, "label": label, "stage": "decided" if end_ns is None else "ended", **times, **fields}


def test_the_aftermath_tells_what_was_lost_from_what_nobody_could_hear():
    performed = [Movement(label, 4 * n * SECOND_NS, (4 * n + 2) * SECOND_NS) for n, label in enumerate("abcdefgh")]
    times = [t / 10 for t in range(340) if not 120 < t < 140]
    verdicts = [
        word("1", "a", 0.1), word("1", "a", 0.1, 2.1),
        word("2", "x", 4.1), word("2", "x", 4.1, 6.1),
        word("5", "e", 16.1), word("5", "e", 16.1, 17.9, same_as="5b"), word("5b", "e", 16.2, 18.0),
        word("6", "f", 20.1), word("7", "g", 24.1), word("7", "g", 24.2, 25.0), word("8", "g", 25.1, 25.9),
        # Both services have decided when the halves of a network meet.
        word("9", "h", 28.1, of="first"), word("9b", "h", 28.2, of="second"),
        word("9", "h", 28.1, 28.8, of="first", same_as="9b"), word("9b", "h", 28.2, 30.0, of="second"),
    ]  # fmt: skip
    result = aftermath(performed, [judged(at_s) for at_s in times], verdicts)
    assert (result.right, result.unended, result.wrong) == (5, ["6"], [(1, "b", ["x"])])
    assert (result.lost, result.unheard, result.doubled) == ([(2, "c")], [(3, "d")], [(6, ["7", "8"])])
    assert not result.harmless and not result.few
    one_observer = [judged(at_s, 1 if 80 <= at_s * 10 <= 100 else 2) for at_s in times]
    assert aftermath(performed, one_observer, verdicts).few == [2]
