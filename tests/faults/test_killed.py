"""Processes of every kind are killed again and again: each verdict of a known performance is published once."""

import os
import random
import threading
import time
from statistics import median

from fault_stage import SECOND_NS, SERVICES, SETTLE_S, VIEWS, all_count, counted, tally

KINDS = ("observer", "leader", "standby", "router", "hub")
SEED = 20081
GROWTH = 1.25
"""How much a process may grow; Zenoh's buffers fill in the first seconds."""


def victim(kind, witness, rng):
    """The process to kill."""
    if kind == "observer":
        return rng.choice(list(VIEWS))
    if kind in ("leader", "standby"):
        witness.look()
        leads = witness.last["fusion"]
        return leads if kind == "leader" else next(one for one in SERVICES if one != leads)
    return kind


def test_no_verdict_is_lost_or_doubled_when_processes_are_killed(team, long_form):
    kills = int(os.environ.get("LABANMESH_KILLS", "100" if long_form else len(KINDS)))
    rng = random.Random(int(os.environ.get("LABANMESH_FAULTS_SEED", SEED)))  # noqa: S311 - chance to be repeated
    witness = team.witness()
    witness.wait_for(all_count, why="all count")
    since_ns, sizes, deck, killed, gaps = time.time_ns(), Sizes(team, witness), [], [], []
    for _ in range(kills):
        deck = deck or rng.sample(KINDS, len(KINDS))
        kind = deck.pop()
        name = victim(kind, witness, rng)
        sizes.note(name)
        killed.append((time.time_ns(), kind))
        rest = ("router", *(one for one in SERVICES if one != name))
        before_s = team.waited_s(*rest) if kind == "leader" else 0.0
        team.processes[name].kill()
        pass_time(rng.uniform(0.0, 0.5))
        team.start(name)
        await_all(team, witness, name)
        if kind == "leader":
            # What the other service and the router wait for a processor is not theirs.
            gaps.append(takeover_s(witness, name, killed[-1][0]) - (team.waited_s(*rest) - before_s))
        sizes.begin(name)
        pass_time(rng.uniform(0.0, 2.0))
    until_ns = time.time_ns()
    witness.wait_for(lambda w: w.last["at_ns"] > until_ns + SETTLE_S * SECOND_NS, why="the last movement is judged")
    result = tally(team.replay.performed(team.start_ns, since_ns, until_ns), witness.verdicts)
    print(f"{kills} kills, {len(result.performed)} movements; memory at most x{sizes.growth():.2f}")
    print(f"without a judgement when the leader was killed: {max(gaps):.3f} s at most, median {median(gaps):.3f}")
    faults = [(movement, fault) for movement, fault in result.faults if not was_unheard(witness, movement, fault)]
    print(f"unheard: {len(result.faults) - len(faults)}")
    assert result.performed
    witnessed = "\n".join(line for movement, _ in faults for line in story(witness, movement))
    assert not faults, f"{faults}\n{result.explained(killed)}\n{witnessed}\n{team.logs()}"
    assert max(gaps) < 1.0
    assert sizes.growth() < GROWTH, sizes.pairs


def was_unheard(witness, movement, fault):
    """Whether no observer counted in its first half, and it was called unknown: a busy machine starts a router late."""
    half_ns = (movement.began_ns + movement.ended_ns) // 2
    heard = (one["agreement"]["n"] for one in witness.judgements if movement.began_ns < one["at_ns"] < half_ns)
    return fault in ("is abstain", "has 0 verdicts []") and not any(heard)


def story(witness, movement):
    """The verdicts about a movement, and each change of a vote while it went on; times in seconds from its begin."""
    names, before = ("id", "stage", "label", "fusion", "began_ns", "ended_ns", "why"), None
    for one in witness.verdicts:
        if one["began_ns"] < movement.ended_ns and movement.began_ns < (one["ended_ns"] or one["decided_ns"]):
            yield str({name: one.get(name) for name in names})
    for one in witness.judgements:
        votes = {
            name: (vote["state"], vote.get("label"), round(vote.get("rest") or 0.0, 1))
            for name, vote in one["votes"].items()
        }
        if movement.began_ns <= one["at_ns"] <= movement.ended_ns and votes != before:
            before = votes
            yield f"{(one['at_ns'] - movement.began_ns) / SECOND_NS:.2f} {one['fusion']}: {votes}"


def takeover_s(witness, dead, killed_ns):
    """From the last judgement of a killed leader to the first of the other."""
    times = [(one["arrived_ns"], one["fusion"]) for one in witness.judgements]
    first_ns = min(at_ns for at_ns, fusion in times if fusion != dead and at_ns > killed_ns)
    return (first_ns - max(at_ns for at_ns, fusion in times if fusion == dead and at_ns < first_ns)) / SECOND_NS


def await_all(stage, witness, name):
    """Until the process just started takes part: an observer counts, a fusion service has a status."""
    at_ns, process = time.time_ns(), stage.processes[name]
    lines = process.lines
    witness.wait_for(
        lambda w: w.last["at_ns"] > at_ns and counted(w.last, *VIEWS), why=f"all count after {name} began anew"
    )
    if name in SERVICES:
        witness.wait_for(lambda w: any(s["id"] == name and s["at_ns"] > at_ns for s in w.statuses), why=f"{name} runs")
    if name == "hub":
        assert process.wait_for_more(lines), process.log


def pass_time(seconds):
    """So that chance, and not the harness, chooses at which moment of a movement a process dies."""
    threading.Event().wait(seconds)


class Sizes:
    """Memory of each process (kB), soon after it began and last; a killed one begins anew."""

    def __init__(self, stage, witness):
        self._processes = {**stage.processes, "witness": witness.process}
        self.pairs = {name: [] for name in self._processes}
        for name in self._processes:
            self.begin(name)

    def begin(self, name):
        self.pairs[name].append([self._processes[name].rss_kb] * 2)

    def note(self, name):
        self.pairs[name][-1][1] = self._processes[name].rss_kb

    def growth(self):
        """The largest ratio of last to first."""
        for name in self.pairs:
            self.note(name)
        return max(last / first for each in self.pairs.values() for first, last in each)
