"""Hubs of each kind come and go twenty times at scenes of a many-scene service, whose judging they never interrupt."""

import signal
import time

import pytest

ROUNDS = 20


def test_hubs_that_start_and_stop_interrupt_no_judging(stage, long_form):
    if not long_form:
        pytest.skip("real hubs belong to the long form: make attacks")
    since_ns = time.time_ns()
    for n in range(ROUNDS):
        # Now the scene with a standby service, now another.
        commands = stage.hub_commands(f"round{n}", scene=n % 2)
        hubs = {kind: stage.start(f"{kind} {n}", *words) for kind, words in commands.items()}
        for kind, hub in hubs.items():
            hub.wait_for({"watch": '"kind"', "dashboard": "http://", "mqtt": "connected to"}.get(kind, ""))
        for kind, hub in hubs.items():
            hub.send(signal.SIGTERM)
            hub.wait()
            del stage.processes[f"{kind} {n}"]
    gaps = stage.gaps(since_ns)
    print({name: round(gap, 3) for name, gap in gaps.items()})
    assert max(gaps.values()) <= stage.longest_gap_s, gaps
    # The first has a standby service, which may lead since an earlier attack.
    assert {owner for name in stage.names[1:] for owner in stage.witness.leaders(name, since_ns)} == {"fusion"}
