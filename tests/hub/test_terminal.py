"""The picture in the terminal: all that should be there, never wider or higher than there is room."""

import io

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from common.messages import Contribution, ObserverStatistics, OngoingMovement
from hub.anticipation import Anticipation
from hub.scene_state import SceneState
from hub.terminal import render
from hub.terminal_widgets import ShareBar


def drawn(renderable, width=80, encoding=None):
    file = io.TextIOWrapper(io.BytesIO(), encoding or "utf-8")
    console = Console(file=file, width=width, force_terminal=False, legacy_windows=False)
    console.print(renderable)
    file.flush()
    return file.buffer.getvalue().decode(encoding or "utf-8")


def scene(said, judges=4, verdicts=3, label="nthrow"):
    votes = {f"cam{i}": said.vote(weight=1 / judges) for i in range(judges)}
    state = SceneState("room").fold(said.vocabulary(), said.NOON)
    state = state.fold(said.judgement(votes=votes), said.NOON).at(said.NOON)
    for number in range(verdicts):
        state = state.fold(said.verdict(number, votes=votes, label=label), said.NOON)
    return state


def test_each_judge_the_referee_and_the_verdict_are_seen(said):
    text = drawn(render(scene(said), 80))
    for words in ("cam0 agrees", "cam3 agrees", "fusion", "N T H R O W", "4 of 4 agree", "70%", "weight", "1.57 bits"):
        assert words in text


def test_the_referee_stands_between_the_corners(said):
    lines = drawn(render(scene(said), 80)).splitlines()
    row = {name: next(i for i, line in enumerate(lines) if name in line) for name in ("cam1", "fusion", "cam2")}
    assert row["cam1"] < row["fusion"] < row["cam2"]
    assert "cam0" in lines[row["cam1"]], "two corners stand side by side"


def test_one_who_differs_and_one_who_is_not_counted_are_told(said):
    votes = {"a": said.vote("ok"), "b": said.vote(state="stale"), "c": said.vote()}
    state = scene(said).fold(said.judgement(2, said.NOON + 1, votes=votes), said.NOON)
    state = state.fold(said.status("b", "degraded", "camera frozen", 2.0), said.NOON)
    text = drawn(render(state, 80))
    assert "a differs" in text and "b agrees, stale" in text and "degraded, 2 Hz, camera frozen" in text


def test_a_wrong_clock_bad_messages_and_who_stands_by_are_told(said):
    late = said.vote().model_copy(update={"skew_s": -3600.0})
    state = scene(said).fold(said.judgement(2, said.NOON + 1, votes={"cam1": late, "cam2": said.vote()}), said.NOON)
    account = {"cam2": ObserverStatistics(skew_s=0.001, rejected={"malformed": 3, "repeated": 4})}
    leader = said.status("fuse1").model_copy(update={"observers": account})
    state = state.fold(leader, said.NOON, "fusion").fold(said.status("fuse2"), said.NOON, "fusion")
    text = drawn(render(state, 120))
    assert "clock -60 min" in text and "7 bad messages" in text and "fuse2 standing by" in text
    assert "clock" not in text.replace("clock -60 min", "")


HOW = {"effort_time": [0.1, 0.9], "effort_weight": [0.8, 0.2], "shape_vertical": [0.1, 0.8, 0.1]}


def how(said):
    more = {
        "facets": HOW,
        "facing_deg": 90.0,
        "unlearned": 0.25,
        "movement": OngoingMovement(id="v9", began_ns=said.NOON),
    }
    return said.judgement(2, said.NOON + 1).model_copy(update=more)


def test_how_it_is_done_and_something_else_are_seen_where_there_is_room(said):
    state = scene(said, 2).fold(how(said), said.NOON)
    text = drawn(render(state, 100))
    assert "something else" in text and "25%" in text
    (row,) = [line for line in text.splitlines() if "sudden" in line]
    assert row.split("sustained")[1].split("┼")[0].strip(" ─") == "" and "┼━━" in row and "rising" in row
    assert "━┼" in next(line for line in text.splitlines() if "strong" in line)
    assert "facing ← 90° left" in text
    assert "facing 90 deg left" in drawn(render(state, 100), 100, "ascii")
    for height in (18, 22, 24, 40):
        lines = drawn(render(state, 80, height)).splitlines()
        assert len(lines) <= height and max(map(len, lines)) <= 80
    assert "sudden" not in drawn(render(state, 80, 18)) and "sudden" in drawn(render(state, 80, 40))


def test_an_early_word_stands_where_the_verdict_will(said):
    foresight = Anticipation(0.3)
    foresight.update(said.judgement(p=(0.25, 0.25, 0.25, 0.25)), 0.0)
    foresight.update(how(said), 0.0)
    state = scene(said, 2).fold(how(said), said.NOON)
    assert "N T H R O W" in (text := drawn(render(state, 80, early=foresight.open))) and "early, 45% sure" in text
    decided = how(said).model_copy(update={"seq": 3, "at_ns": said.NOON + 2, "movement": None})
    state = state.fold(decided, said.NOON)
    assert "early" not in drawn(render(state, 80, early=foresight.open))


def test_the_log_says_what_each_judge_gave(said):
    gave = {"cam0": Contribution(nats=0.614, stands=False), "cam1": Contribution(nats=-0.2, stands=True)}
    state = scene(said, 2, 0).fold(said.verdict(1, contributions=gave), said.NOON)
    assert "not without cam0; cam0 +0.61, cam1 -0.20" in drawn(render(state, 120), 120)


def test_a_silent_referee_is_told(said):
    state = scene(said).at(said.NOON + 5 * said.SECOND)
    assert "silent for 5.0 s" in drawn(render(state, 80))


def test_a_scene_of_which_nothing_was_heard(said):
    text = drawn(render(SceneState("room", ("cam1", "cam2")), 80))
    assert "waiting for fusion" in text and "cam1 silent" in text and "no verdict yet" in text


def test_an_abstention_is_a_verdict(said):
    assert "A B S T A I N" in drawn(render(scene(said, label="abstain"), 80))


def test_a_strangers_words_do_not_steer_the_terminal(said):
    evil = "\x1b[2J\x07[red]x\u202e"
    state = scene(said, label=evil).fold(said.status("cam1", "failed", evil), said.NOON)
    text = drawn(render(state, 100))
    assert "\x1b" not in text and "\x07" not in text and "\u202e" not in text and "[red]x" in text


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 9), st.integers(0, 12), st.integers(24, 160))
def test_no_line_is_wider_than_the_terminal(said, judges, verdicts, width):
    assert max(map(len, drawn(render(scene(said, max(judges, 1), verdicts), width), width).splitlines())) <= width


@pytest.mark.parametrize(("judges", "height"), [(2, 18), (2, 24), (4, 19), (4, 20), (4, 22), (4, 24), (4, 50), (6, 30)])
def test_it_fits_the_terminals_height(said, judges, height):
    lines = drawn(render(scene(said, judges, 10), 80, height)).splitlines()
    assert len(lines) <= height
    assert sum("agree  1.57 bits" in line and "┃" not in line for line in lines) >= min(2, height - 18)


def test_bars_are_as_long_as_the_share():
    assert drawn(ShareBar(0.5), 10).strip("\n") == "━" * 5 + "─" * 5
    assert drawn(ShareBar(0.25), 10).strip("\n") == "━━╸" + "─" * 7
    assert drawn(ShareBar(2.0), 4).strip("\n") == "━━━━"
    assert drawn(ShareBar(0.5), 10, "ascii").strip("\n") == "#####....."


def test_a_terminal_without_unicode_is_served(said):
    assert "N T H R O W" in drawn(render(scene(said), 80), 80, "ascii")
