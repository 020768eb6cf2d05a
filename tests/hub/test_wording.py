"""Phrases for people: the same words in every view."""

import pytest

from hub.wording import dissent, facing_words, judgement_line, leanings, verdict_line


def test_facets_lean_to_a_pole_and_unknown_or_incomplete_ones_are_left_out():
    facets = {"shape_vertical": [0.1, 0.2, 0.7], "effort_time": [0.8, 0.2], "effort_flow": [0.5], "mood": [1.0]}
    time, vertical = leanings(facets)
    assert (time.facet, time.value, time.p, time.poles) == ("effort_time", "sustained", 0.8, ("sustained", "sudden"))
    assert time.lean == pytest.approx(-0.6) and vertical.value == "rising"
    assert leanings(None) == ()


def test_the_facing_is_in_words():
    words = [facing_words(degrees) for degrees in (0, 45, 180, 270, 359.7)]
    assert words == ["front", "45° left", "back", "90° right", "front"]


def test_a_judgement_without_observers_names_no_movement(make):
    line = judgement_line(make.waiting())
    assert line.endswith("judgement  waiting for observers  cam1: silent, cam2: silent")


def test_a_vote_without_a_label_is_undecided_and_a_stale_one_is_heard(make):
    votes = {"a": make.vote(None), "b": make.vote(state="stale", weight=0.25), "c": make.vote(state="late")}
    line = judgement_line(make.judgement(votes=votes | {"d": make.vote(None, state="stale", rest=None)}))
    assert "1 of 3 agree" in line and "a: undecided 0.50, b: nthrow 0.25 stale, c: late, d: sees nobody" in line


def test_dissent_is_of_all_votes_that_are_heard(make):
    votes = {"a": make.vote("ok", state="stale"), "b": make.vote("ok", state="late"), "c": make.vote()}
    assert dissent(make.verdict(votes=votes)) == "a: ok"
    assert dissent(make.verdict(votes=votes, label="abstain")) == "a: ok, c: nthrow"
    assert "nthrow  1 of 2 agree  1.57 bits  a: ok" in verdict_line(make.verdict(votes=votes))
