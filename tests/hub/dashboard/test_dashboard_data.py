"""What the page gets as JSON: the history of a scene, and the reasons for a verdict."""

import json

import pytest

from common.message_types import BodyRegionShares
from common.messages import Contribution
from hub.dashboard.history import LOG_LIMIT, SceneHistory
from hub.dashboard.page_data import CROWD, PageSetup, snapshot_data, state_data, verdict_data
from hub.dashboard.placement import floor_positions
from hub.dashboard.verdict_reasons import reasons
from hub.scene_state import SceneState

SETUP = PageSetup("room", floor_positions({"cam1": "door", "cam2": "wheel"}, {"cam1": 0.0, "cam2": 90.0}), quorum=1)


@pytest.fixture
def after(make):
    """The history after messages that arrived at their own time, or at `now_ns`."""

    def after_messages(*messages, now_ns=None, observers=("cam1", "cam2")):
        history = SceneHistory(SceneState("room", observers, make.NOON).fold(make.vocabulary(), make.NOON))
        for message in messages:
            at_ns = now_ns or message.at_ns
            history = history.update(history.state.at(at_ns).fold(message, at_ns), message)
        return history

    return after_messages


def test_a_verdict_has_its_score_and_why_names_the_judges(make, after):
    ended = make.verdict(
        1, ended_ns=make.NOON, score=7.84, scores={"cam1": 7.1, "cam2": 8.6}, remarks=["left knee: 12 degrees ..."]
    )
    data = json.loads(json.dumps(verdict_data(ended, after(ended), None), allow_nan=False))
    assert data["score"] == 7.8 and "Left knee: 12 degrees ...." in data["why"]
    assert "Scored 7.8 of 10 against the reference takes: cam1 7.1, cam2 8.6." in data["why"]
    plain = verdict_data(make.verdict(1), after(make.verdict(1)), None)
    assert plain["score"] is None and not any("cored" in each for each in plain["why"])
    none = make.verdict(1, ended_ns=make.NOON, unscored="its begin was not seen")
    assert "Not scored: its begin was not seen." in verdict_data(none, after(none), None)["why"]


def test_a_snapshot_has_all_that_a_browser_needs(make, after):
    history = after(make.judgement(), make.verdict(1))
    whole = json.loads(json.dumps(snapshot_data(SETUP, history), allow_nan=False))
    assert whole["positions"]["cam2"] == {"azimuth": 90.0, "known": True, "view": "wheel"}
    assert [observer["name"] for observer in whole["state"]["observers"]] == ["cam1", "cam2"]
    assert whole["state"]["fused"][0] == ["nthrow", 0.6] and len(whole["minute"]) == 1
    assert whole["verdicts"][0]["label"] == "nthrow" and whole["verdicts"][0]["votes"][0]["stance"] == "held ok"


def test_a_revision_and_the_reason_of_a_silence_are_in_the_data(make, after):
    lacks = "nthrow 79 % of the 80 % needed"
    revised = make.verdict(1, stage="revised", revises="ok")
    history = after(make.moving(why=lacks), make.verdict(1, label="ok"), revised)
    assert state_data(history)["why"] == lacks and state_data(after(make.judgement()))["why"] is None
    (shown,) = snapshot_data(SETUP, history)["verdicts"]
    assert (shown["stage"], shown["label"], shown["revises"]) == ("revised", "nthrow", "ok")
    assert "It is a correction: before, the referee said ok." in shown["why"]
    abstained = make.verdict(2, ended_ns=make.NOON, label="abstain", why=lacks)
    assert f"What a verdict lacked: {lacks}." in verdict_data(abstained, history, 1)["why"]


def test_long_text_is_cut(make, after):
    setup = PageSetup("room", floor_positions({"cam1": "x" * 1000}, {"cam1": None}))
    text = json.dumps(
        snapshot_data(setup, after(make.judgement().model_copy(update={"rule": "y" * 1000}))), ensure_ascii=False
    )
    assert "xxx…" in text and "yyy…" in text and not any(letter * 100 in text for letter in "xy")


def test_a_vote_agrees_also_when_it_is_stale(make, after):
    states = {"nthrow": ["stale", "counted", "late"], "ok": ["counted"]}
    votes = [make.vote(label, state=state) for label, each in states.items() for state in each]
    state = state_data(after(make.judgement(votes={f"cam{i}": vote for i, vote in enumerate(votes)}), observers=()))
    assert state["agreement"] == [2, 3]
    assert [(each["agrees"], each["heard"]) for each in state["observers"]] == [
        (True, True), (True, True), (False, False), (False, True),
    ]  # fmt: skip


def test_without_observers_the_page_names_no_movement(make, after):
    history = after(make.judgement(), make.waiting(2, make.NOON + make.SECOND))
    state = state_data(history)
    assert state["waiting"] and state["judged"] and state["label"] is None and state["fused"] == []
    assert len(history.minute) == 1, "the strip has a gap"
    assert not state_data(after(make.judgement()))["waiting"] and not state_data(after())["judged"]


def test_the_log_is_bounded(make, after):
    verdicts = after(*(make.verdict(i, at_ns=make.NOON + i) for i in range(LOG_LIMIT + 20))).verdicts
    assert len(verdicts) == LOG_LIMIT and verdicts[0].id == f"v{LOG_LIMIT + 19}"


def test_the_minute_is_thin_and_a_minute_long(make, after):
    judgements = [make.judgement(i, make.NOON + i * make.SECOND // 10) for i in range(900)]
    minute = after(*judgements).minute
    assert 295 <= len(minute) <= 302 and minute[-1].at_ns - minute[0].at_ns <= 60 * make.SECOND
    back = after(*judgements, make.judgement(901, make.NOON + 40 * make.SECOND)).minute
    assert back[-1].at_ns == max(each.at_ns for each in back), "after a clock was set back no later points are left"


def test_an_observer_whose_token_went_is_gone(make, after):
    history = after(make.judgement()).with_presence({"cam1", "cam2"}).with_presence({"cam1"})
    observers = state_data(history)["observers"]
    assert [(each["gone"], each["present"]) for each in observers] == [(False, True), (True, False)]
    assert history.with_presence({"cam1"}) is history


def test_a_crowd_is_short(make, after):
    votes = {f"cam{i}": make.vote() for i in range(CROWD + 1)}
    observers = state_data(after(make.judgement(votes=votes), observers=()))["observers"]
    assert len(observers) == CROWD + 1 and all(len(observer["ranked"]) == 1 for observer in observers)


def test_times_are_those_of_the_fusion_machine(make, after):
    history = after(make.judgement(), now_ns=make.NOON + 3600 * make.SECOND)
    assert state_data(history)["now"] == make.NOON // 10**6


def test_facets_and_facing_are_null_where_they_are_unknown(make, after):
    how = {"facets": {"effort_time": [0.2, 0.8], "effort_flow": [1.0], "mood": [1.0]}, "facing_deg": -45.0}
    state = state_data(after(make.judgement(**how)))
    assert state["facets"] == [["effort_time", "sustained", "sudden", 0.6, "sudden", 0.8]]
    assert state["facing"] == [315, "45° right"]
    unknown = state_data(after(make.judgement()))
    assert (unknown["facets"], unknown["facing"]) == ([], None)


def test_a_verdict_in_an_unknown_vocabulary_has_no_probabilities(make):
    assert verdict_data(make.verdict(1), SceneHistory(SceneState("room")), None)["fused"] == []


@pytest.fixture
def why(make):
    """The reasons of a verdict with these fields, as one text."""
    return lambda quorum=2, **fields: " ".join(reasons(make.verdict(1, **fields), quorum))


def test_the_reasons_say_whose_vote_was_needed(make, why):
    votes = {"a": make.vote(weight=0.6), "b": make.vote(weight=0.3), "c": make.vote("ok", weight=0.1)}
    assert "2 of 3 judges held nthrow: a and b. Each of them was needed" in why(2, votes=votes)
    assert "c held ok." in why(2, votes=votes) and "a weighed most, 60%" in why(2, votes=votes)
    assert "no single judge" in why(1, votes=votes) and "needed" not in why(None, votes=votes)
    assert "1 of 1 judge held nthrow: a. That judge was needed" in why(1, votes={"a": make.vote()})
    assert "0 of 1 judge held nthrow alone; together they did." in why(1, votes={"a": make.vote("ok")})


def test_the_reasons_say_who_was_late_stale_or_silent(make, why):
    votes = {
        "a": make.vote(),
        "b": make.vote(state="stale", age_s=0.7),
        "c": make.vote(state="late", age_s=3.0),
        "d": make.vote(None, state="silent", age_s=None),
        "e": make.vote(None),
        "f": make.vote(None, state="stale", rest=None),
    }
    text = why(1, votes=votes)
    assert "b was stale (700 ms old)" in text and "c was late (3.0 s behind)" in text and "d was silent" in text
    assert "e believed no more of one movement than of another" in text and "f saw nobody" in text
    silent = {f"cam{i}": make.vote(state="silent") for i in range(50)}
    assert "50 judges did not count in full" in why(1, votes=silent)


def test_the_reasons_say_without_whom_the_answer_changes(make, after):
    contributions = {"cam1": Contribution(nats=-0.25, stands=True), "cam2": Contribution(nats=1.456, stands=False)}
    verdict = make.verdict(1, contributions=contributions)
    votes = verdict_data(verdict, after(), 1)["votes"]
    assert [(each["gave"], each["stands"]) for each in votes] == [(-0.25, True), (1.46, False)]
    assert "Without cam2 another answer would have been the likeliest." in reasons(verdict, 1)
    both = {name: Contribution(nats=0.5, stands=True) for name in contributions}
    same = "Without any one of them the likeliest answer would have been the same."
    assert same in reasons(make.verdict(1, contributions=both), 1)
    assert verdict_data(make.verdict(1), after(), 1)["votes"][0]["gave"] is None


def test_the_reasons_say_what_each_judge_leans_on_for_the_movement_of_the_verdict(make, after):
    own = BodyRegionShares(
        hash=make.vocabulary().hash, regions=["trunk", "right arm"], shares=[[50, 50], [0, 100], [100, 0], [12, 81]]
    )
    silent = make.vote(state="silent")
    votes = {"cam1": make.vote(weight=0.3), "cam2": make.vote(weight=0.6), "cam3": make.vote(), "cam4": silent}

    def lines_of(verdict, *tables):
        statuses = [make.status(f"cam{i}", at_ns=make.NOON, leans_on=each) for i, each in enumerate(tables, 1)]
        return [line for line in verdict_data(verdict, after(*statuses), 1)["why"] if "leans on" in line]

    verdict, line = make.verdict(1, votes=votes), "leans on right arm 81%, trunk 12%."
    assert lines_of(verdict, own, own, None, own) == [f"cam2 {line}", f"cam1 {line}"], "the heaviest first"
    assert lines_of(make.verdict(1, make.NOON, votes=votes, label="abstain"), own) == []
    others = own.model_copy(update={"hash": "0" * 16}), own.model_copy(update={"shares": own.shares[:2]})
    assert lines_of(verdict, *others) == [], "a judge with other movements, and one that lies"
    many = {f"cam{i}": make.vote() for i in range(1, 51)}
    assert len(lines_of(make.verdict(1, votes=many), *[own] * 50)) == 6


def test_the_reasons_of_an_abstention(make, why):
    ended = {"label": "abstain", "ended_ns": make.NOON}
    text = why(votes={"a": make.vote(None)}, unlearned=0.9, **ended)
    assert "none of those they know (90%)" in text and "did not agree" not in text and "a held no movement" in text
    text = why(votes={"a": make.vote(), "b": make.vote("ok")}, **ended)
    assert "did not agree" in text and "a held nthrow and b held ok" in text


def test_what_is_repeated_is_counted_live_and_in_the_verdict(make, after):
    moving = make.moving(decided="ok", repetitions=8, partial_repetitions=2)
    assert state_data(after(moving))["count"] == {"id": "v1", "label": "ok", "done": 8, "partial": 2}
    assert state_data(after(make.moving(decided="ok")))["count"] is None, "it is no repeated movement"
    shown = verdict_data(make.verdict(1, label="ok", repetitions=10**9), after(moving), 1)["count"]
    assert shown["done"] == 999_999 and shown["partial"] == 0
