"""Observers whose clocks are an hour fast, an hour slow, or stand still: their votes count, by their true age."""

import sys
from statistics import median

import pytest
from fault_processes import Process
from fault_stage import HERE, LONG_FORM, VIEWS, Stage, all_count, counted, judged

HOUR_S = 3600.0


@pytest.mark.parametrize("shift_s", [HOUR_S, pytest.param(-HOUR_S, marks=LONG_FORM)])
def test_the_votes_of_an_observer_in_another_hour_have_their_true_age(replay, tmp_path, long_form, shift_s):
    with Stage(replay, tmp_path) as stage:
        stage.with_clock("door", shift_s)
        stage.play()
        witness = stage.witness()
        witness.wait_for(all_count, why="all count, the one with the wrong clock too")
        witness.wait_for(lambda w: w.last["votes"]["door"].get("skew_s") is not None, why="its clock is measured")
        judged(stage, witness, movements=8 if long_form else 1)
        # On a busy machine there may be fewer since it counts.
        ages_s = [one["votes"]["door"]["age_s"] for one in witness.judgements[-60:] if counted(one, "door")]
        # A busy machine delays some; a wrong clock would show in all.
        assert min(ages_s) >= 0 and median(ages_s) < 0.5, ages_s
        known = [s["observers"]["door"]["skew_s"] for s in witness.statuses if s["id"] == "fusion" and s["observers"]]
        skews_s = [skew_s for skew_s in known if skew_s is not None]
        assert abs(median(skews_s) - shift_s) < 0.2, skews_s


@LONG_FORM
def test_the_votes_of_an_observer_whose_clock_stands_still_date_from_their_arrival(replay, tmp_path):
    with Stage(replay, tmp_path, observers=(*VIEWS, "echo"), extra="quorum = 2") as stage:
        command = [sys.executable, str(HERE / "fault_peers.py"), "echo", str(stage.file), "door", "echo"]
        stage.processes["echo"] = Process(command)
        stage.play()
        witness = stage.witness()
        witness.wait_for(lambda w: counted(w.last, *VIEWS, "echo"), why="all count, the stopped one too")
        judged(stage, witness, movements=8)
        votes = [one["votes"]["echo"] for one in witness.judgements[-60:]]
        assert all(vote["state"] == "counted" for vote in votes) and median(v["age_s"] for v in votes) < 0.5, votes
