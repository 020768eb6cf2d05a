"""What the page is told: the chronicle, its picture as JSON, and why a verdict is what it is."""

import json

from common.messages import Contribution, VerdictMessage
from hub.dashboard.history import LOG_LIMIT, SceneHistory
from hub.dashboard.page_data import CROWD, PageSetup, reasons, snapshot_data, state_data, verdict_data
from hub.dashboard.placement import floor_positions
from hub.scene_state import SceneState

SETUP = PageSetup("room", floor_positions({"cam1": "door", "cam2": "wheel"}, {"cam1": 0.0, "cam2": 90.0}), quorum=1)


def told(said, *messages, now_ns=None, observers=("cam1", "cam2")):
    chronicle = SceneHistory(SceneState("room", observers, said.NOON).fold(said.vocabulary(), said.NOON))
    for message in messages:
        known = chronicle.state.at(now_ns or message.at_ns).fold(message, now_ns or message.at_ns)
        chronicle = chronicle.update(known, message)
    return chronicle


def test_a_snapshot_has_all_that_a_browser_needs(said):
    whole = json.loads(json.dumps(snapshot_data(SETUP, told(said, said.judgement(), said.verdict(1))), allow_nan=False))
    assert whole["positions"]["cam2"] == {"azimuth": 90.0, "known": True, "view": "wheel"}
    assert [judge["name"] for judge in whole["state"]["observers"]] == ["cam1", "cam2"]
    assert whole["state"]["fused"][0] == ["nthrow", 0.6] and len(whole["minute"]) == 1
    assert whole["verdicts"][0]["label"] == "nthrow" and whole["verdicts"][0]["votes"][0]["stance"] == "held ok"


def test_endless_words_do_not_reach_the_page(said):
    long = said.judgement(votes={"cam1": said.vote("x" * 1000)}, label="y" * 1000)
    text = json.dumps(snapshot_data(SETUP, told(said, long)), allow_nan=False, ensure_ascii=False)
    assert "xxx…" in text and "x" * 100 not in text and "y" * 100 not in text


def test_the_log_is_longer_than_a_terminals_and_ends(said):
    many = [said.verdict(i, at_ns=said.NOON + i) for i in range(LOG_LIMIT + 20)]
    chronicle = told(said, *many)
    assert len(chronicle.verdicts) == LOG_LIMIT and chronicle.verdicts[0].id == f"v{LOG_LIMIT + 19}"


def test_a_verdict_said_again_takes_its_place_and_an_older_word_does_not(said):
    first, ended = said.verdict(1), said.verdict(1, ended_ns=said.NOON, at_ns=said.NOON + 9)
    chronicle = told(said, first, said.verdict(2, at_ns=said.NOON + 5), ended, first)
    assert [(each.id, each.ended_ns) for each in chronicle.verdicts] == [("v2", None), ("v1", said.NOON)]


def test_the_minute_is_thin_and_a_minute_long(said):
    said_each = [said.judgement(i, said.NOON + i * said.SECOND // 10) for i in range(900)]
    minute = told(said, *said_each).minute
    assert 295 <= len(minute) <= 302 and minute[-1].at_ns - minute[0].at_ns <= 60 * said.SECOND
    back = told(said, *said_each, said.judgement(901, said.NOON + 40 * said.SECOND)).minute
    assert back[-1].at_ns == max(each.at_ns for each in back), "a clock set back leaves no points of the future"


def test_who_was_there_and_went_is_gone(said):
    chronicle = told(said, said.judgement()).with_presence({"cam1", "cam2"}).with_presence({"cam1"})
    assert [judge["gone"] for judge in state_data(chronicle)["observers"]] == [False, True]
    assert chronicle.with_presence({"cam1"}) is chronicle


def test_a_crowd_is_told_in_short(said):
    names = [f"cam{i}" for i in range(CROWD + 1)]
    judges = state_data(told(said, said.judgement(votes={name: said.vote() for name in names}), observers=()))[
        "observers"
    ]
    assert len(judges) == CROWD + 1 and all(len(judge["ranked"]) == 1 for judge in judges)


def test_times_are_the_fusion_machines(said):
    hour = 3600 * said.SECOND
    chronicle = told(said, said.judgement(), now_ns=said.NOON + hour)
    assert state_data(chronicle)["now"] == said.NOON // 10**6


def sentences(said, quorum=2, votes=None, **more):
    spoken = said.verdict(1, votes=votes, **more)
    assert isinstance(spoken, VerdictMessage)
    return " ".join(reasons(spoken, quorum))


def test_whose_word_was_needed_is_said(said):
    votes = {"a": said.vote(weight=0.6), "b": said.vote(weight=0.3), "c": said.vote("ok", weight=0.1)}
    assert "2 of 3 judges held nthrow: a and b. Each of them was needed" in sentences(said, 2, votes)
    assert "c held ok." in sentences(said, 2, votes) and "a weighed most, 60%" in sentences(said, 2, votes)
    assert "no single judge" in sentences(said, 1, votes)
    assert "needed" not in sentences(said, None, votes)


def test_who_was_late_stale_or_silent_is_said(said):
    votes = {
        "a": said.vote(),
        "b": said.vote(state="stale", age_s=0.7),
        "c": said.vote(state="late", age_s=3.0),
        "d": said.vote(None, state="silent", age_s=None),
        "e": said.vote(None),
    }
    text = sentences(said, 1, votes)
    assert "b was stale (700 ms old)" in text and "c was late (3.0 s behind)" in text and "d was silent" in text
    assert "e believed no more of one movement than of another" in text
    crowd = {f"cam{i}": said.vote(state="silent") for i in range(50)}
    assert "50 judges did not count in full" in sentences(said, 1, crowd)


def test_something_else_is_an_answer_among_the_others(said):
    other = {"unlearned": 0.5}
    votes = {"cam1": said.vote().model_copy(update=other)}
    whole = snapshot_data(
        SETUP, told(said, said.judgement(votes=votes).model_copy(update=other), said.verdict(1, **other))
    )
    assert (
        whole["state"]["fused"][:2] == [["something else", 0.5], ["nthrow", 0.3]] == whole["verdicts"][0]["fused"][:2]
    )
    assert whole["state"]["observers"][0]["ranked"][:2] == [["something else", 0.5], ["nthrow", 0.35]]
    assert whole["minute"][0][2] == 0.5, "the probability of what is believed most"


def test_how_it_is_done_is_told_and_nonsense_is_not(said):
    how = {"facets": {"effort_time": [0.2, 0.8], "effort_flow": [1.0], "mood": [1.0]}, "facing_deg": -45.0}
    now = state_data(told(said, said.judgement().model_copy(update=how)))
    assert now["facets"] == [["effort_time", "sustained", "sudden", 0.6, "sudden", 0.8]]
    assert now["facing"] == [315, "45° right"]
    silent = state_data(told(said, said.judgement()))
    assert (silent["facets"], silent["facing"]) == ([], None)


def test_what_each_judge_gave_is_told_and_without_whom_it_falls(said):
    gave = {"cam1": Contribution(nats=-0.25, stands=True), "cam2": Contribution(nats=1.456, stands=False)}
    spoken = said.verdict(1, contributions=gave)
    votes = verdict_data(spoken, told(said), 1)["votes"]
    assert [(each["gave"], each["stands"]) for each in votes] == [(-0.25, True), (1.46, False)]
    assert "Without cam2 another answer would have been the likeliest." in reasons(spoken, 1)
    both = {name: Contribution(nats=0.5, stands=True) for name in gave}
    assert "Without any one of them the likeliest answer would have been the same." in reasons(
        said.verdict(1, contributions=both), 1
    )
    assert verdict_data(said.verdict(1), told(said), 1)["votes"][0]["gave"] is None


def test_an_abstention_for_something_else_is_explained(said):
    text = sentences(said, 2, {"a": said.vote(None)}, label="abstain", ended_ns=said.NOON, unlearned=0.9)
    assert "none of those they know (90%)" in text and "did not agree" not in text
    assert "a held no movement" in text


def test_an_abstention_is_explained(said):
    votes = {"a": said.vote(), "b": said.vote("ok")}
    text = sentences(said, 2, votes, label="abstain", ended_ns=said.NOON)
    assert "did not agree" in text and "a held nthrow and b held ok" in text


def test_a_verdict_in_an_unknown_vocabulary_is_told_without_its_shares(said):
    long = said.verdict(1, label="y" * 5000)
    assert "y" * 500 not in json.dumps(verdict_data(long, told(said), 1))
    chronicle = SceneHistory(SceneState("room"))
    assert verdict_data(said.verdict(1), chronicle, None)["fused"] == []
