"""The picture in the terminal: complete, and never wider or higher than there is room."""

import io
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from common.message_types import SAME_ID_REASON
from common.messages import Contribution, ObserverStatistics, OngoingMovement
from hub.anticipation import Anticipation
from hub.dashboard.history import SceneHistory
from hub.dashboard.page_data import state_data
from hub.scene_state import SceneState
from hub.terminal import render
from hub.terminal_widgets import ShareBar

HOW = {"effort_time": [0.1, 0.9], "effort_weight": [0.8, 0.2], "shape_vertical": [0.1, 0.8, 0.1]}


def drawn(renderable, width=80, encoding="utf-8"):
    file = io.TextIOWrapper(io.BytesIO(), encoding)
    Console(file=file, width=width, force_terminal=False, legacy_windows=False).print(renderable)
    file.flush()
    return file.buffer.getvalue().decode(encoding)


def scene(make, observers=4, verdicts=3, label="nthrow", votes=None):
    """A scene in which all observers agree, or with these votes."""
    votes = votes or {f"cam{i}": make.vote(weight=1 / observers) for i in range(observers)}
    state = SceneState("room").fold(make.vocabulary(), make.NOON)
    state = state.fold(make.judgement(votes=votes), make.NOON).at(make.NOON)
    for number in range(verdicts):
        state = state.fold(make.verdict(number, votes=votes, label=label), make.NOON)
    return state


def crowd(make, count):
    """Every fiftieth observer differs."""
    votes = {f"cam{i:03}": make.vote("ok" if i % 50 == 49 else "nthrow", weight=1 / count) for i in range(count)}
    return scene(make, verdicts=1, votes=votes)


def how(make):
    movement = OngoingMovement(id="v9", began_ns=make.NOON)
    return make.judgement(2, make.NOON + 1, facets=HOW, facing_deg=90.0, unlearned=0.25, movement=movement)


def test_each_observer_fusion_and_the_verdict_are_visible(make):
    text = drawn(render(scene(make), 80))
    for words in ("cam0 agrees", "cam3 agrees", "fusion", "N T H R O W", "4 of 4 agree", "70%", "weight", "1.57 bits"):
        assert words in text
    assert "N T H R O W" in drawn(render(scene(make), 80), 80, "ascii")
    assert "A B S T A I N" in drawn(render(scene(make, label="abstain"), 80))


def test_two_processes_of_one_id_are_a_line_of_their_own_while_it_lasts(make):
    state, counts = scene(make), [0, 3, 3, 3, 5]
    shown = []
    for second, count in enumerate(counts):
        at_ns = make.NOON + 6 * second * make.SECOND
        observers = {"cam1": ObserverStatistics(skew_s=0.0, rejected={"same_id": count} if count else {})}
        state = state.fold(make.status("fuse1", observers=observers), at_ns, "fusion").at(at_ns)
        words = "two processes have the id cam1"
        assert (words in drawn(render(state, 120))) == (state_data(SceneHistory(state))["same_ids"] == words)
        shown.append(words in drawn(render(state, 120)))
        assert ("two processes have this id" in drawn(render(state, 120))) == shown[-1]
    assert shown == [False, True, True, False, True]
    state = state.fold(make.status("fuse1", reason=SAME_ID_REASON), state.now_ns, "fusion")
    assert "two processes have the id cam1, fuse1" in drawn(render(state, 120))


def test_the_stances_are_those_of_the_agreement(make):
    votes = {"a": make.vote("ok"), "b": make.vote(state="stale"), "c": make.vote(), "d": make.vote(None),
             "e": make.vote(state="late"), "f": make.vote(state="stale", rest=None)}  # fmt: skip
    state = scene(make, votes=votes).fold(make.status("b", "degraded", "camera frozen", 2.0), make.NOON)
    text = drawn(render(state, 80))
    for words in ("a differs", "b agrees, stale", "c agrees", "d undecided", "e late", "f sees nobody", "3 of 5 agree"):
        assert words in text
    assert "degraded, 2 Hz, camera frozen" in text


def test_a_revision_and_the_reason_of_a_silence_are_visible(make):
    lacks = "nthrow 79 % of the 80 % needed; 13 % something else"
    state = scene(make, verdicts=0).fold(make.moving(2, why=lacks, at_ns=make.NOON + 1), make.NOON)
    assert f"undecided: {lacks}" in drawn(render(state, 80))
    state = state.fold(make.verdict(1, label="ok"), make.NOON)
    state = state.fold(make.verdict(1, stage="revised", revises="ok"), make.NOON)
    text = drawn(render(state, 100))
    assert "N T H R O W" in text and "revised from ok" in text and "ok -> nthrow" in text
    long = make.moving(3, why="x" * 200, at_ns=make.NOON + 2)
    for width in (30, 80):
        lines = drawn(render(state.fold(long, make.NOON), width, 24), width).splitlines()
        assert len(lines) <= 24 and all(len(line) <= width for line in lines)


@pytest.mark.parametrize("label", ["", "byebye"])
def test_without_observers_the_picture_waits_for_them(make, label):
    text = drawn(render(scene(make, verdicts=0).fold(make.waiting(2, make.NOON + 1, label), make.NOON), 80))
    assert "waiting for observers" in text and "byebye" not in text and "25%" not in text


def test_a_wrong_clock_bad_messages_and_a_standby_are_visible(make):
    late = make.vote(skew_s=-3600.0)
    state = scene(make).fold(make.judgement(2, make.NOON + 1, votes={"cam1": late, "cam2": make.vote()}), make.NOON)
    rejected = {"cam1": {"malformed": 1}, "cam2": {"malformed": 3, "repeated": 4}}
    statistics = {name: ObserverStatistics(skew_s=0.001, rejected=counts) for name, counts in rejected.items()}
    state = state.fold(make.status("fuse1", observers=statistics), make.NOON, "fusion").reject()
    text = drawn(render(state.fold(make.status("fuse2"), make.NOON, "fusion"), 120))
    for words in ("clock -60 min, 1 bad message ", "7 bad messages", "fuse2 standing by", "1 message rejected"):
        assert words in text
    assert "clock" not in text.replace("clock -60 min", "")


def test_how_it_is_done_and_something_else_are_visible_if_there_is_room(make):
    state = scene(make, 2).fold(how(make), make.NOON)
    text = drawn(render(state, 100))
    assert "something else" in text and "25%" in text
    assert "sudden 90%, light 80%, facing 90° left" in text, "neither rising nor sinking"
    for height in (18, 22, 24, 40):
        lines = drawn(render(state, 80, height)).splitlines()
        assert len(lines) <= height and max(map(len, lines)) <= 80
    assert "sudden" in drawn(render(state, 80, 40))


def test_an_early_word_stands_where_the_verdict_will(make):
    anticipation = Anticipation(0.3)
    anticipation.update(make.judgement(p=(0.25, 0.25, 0.25, 0.25)), 0.0)
    anticipation.update(how(make), 0.0)
    state = scene(make, 2).fold(how(make), make.NOON)
    assert "N T H R O W" in (text := drawn(render(state, 80, early=anticipation.open))) and "early, 45% sure" in text
    decided = how(make).model_copy(update={"seq": 3, "at_ns": make.NOON + 2, "movement": None})
    assert "early" not in drawn(render(state.fold(decided, make.NOON), 80, early=anticipation.open))


def test_the_log_shows_contributions(make):
    contributions = {"cam0": Contribution(nats=0.614, stands=False), "cam1": Contribution(nats=-0.2, stands=True)}
    state = scene(make, 2, 0).fold(make.verdict(1, contributions=contributions), make.NOON)
    assert "not without cam0; cam0 +0.61, cam1 -0.20" in drawn(render(state, 120), 120)


def test_silence_is_visible(make):
    assert "silent for 5.0 s" in drawn(render(scene(make).at(make.NOON + 5 * make.SECOND), 80))
    text = drawn(render(SceneState("room", ("cam1", "cam2")), 80))
    assert "waiting for fusion" in text and "cam1 silent" in text and "no verdict yet" in text


def test_words_of_a_peer_do_not_control_the_terminal(make):
    evil = "\x1b[2J\x07[red]x\u202e"
    state = scene(make, label=evil).fold(make.status("cam1", "failed", evil), make.NOON)
    text = drawn(render(state, 100))
    assert "\x1b" not in text and "\x07" not in text and "\u202e" not in text and "[red]x" in text


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 9), st.integers(0, 12), st.integers(24, 160))
def test_no_line_is_wider_than_the_terminal(make, observers, verdicts, width):
    assert max(map(len, drawn(render(scene(make, observers, verdicts), width), width).splitlines())) <= width


@pytest.mark.parametrize(
    ("observers", "height"), [(2, 18), (2, 24), (4, 19), (4, 20), (4, 22), (4, 24), (4, 50), (6, 30)]
)
def test_it_fits_the_terminals_height(make, observers, height):
    lines = drawn(render(scene(make, observers, 10), 80, height)).splitlines()
    assert len(lines) <= height
    assert sum("agree  1.57 bits" in line and "┃" not in line for line in lines) >= min(2, height - 18)


@pytest.mark.parametrize(("count", "width", "height"), [(200, 100, 30), (4, 60, 20), (9, 80, 24), (200, 40, 12)])
def test_fusion_and_those_that_differ_are_visible_in_any_crowd(make, count, width, height):
    text = drawn(render(crowd(make, count), width, height), width)
    assert len(text.splitlines()) <= height and max(map(len, text.splitlines())) <= width
    if count == 200:
        assert " fusion " in text and "N T H R O W" in text and "cam049" in text
    elif count == 9:
        assert all(f"cam{i:03}" in text for i in range(9)) and "more" not in text
    if height == 30:
        assert all(f"cam{i:03}  differs" in text for i in (49, 99, 149, 199))
        assert re.search(r"and \d+ more, all of them agree", text)


def test_bars_are_as_long_as_the_share():
    bars = [drawn(ShareBar(share), width).strip("\n") for share, width in ((0.5, 10), (0.25, 10), (2.0, 4))]
    assert bars == ["━" * 5 + "─" * 5, "━━╸" + "─" * 7, "━━━━"]
    assert drawn(ShareBar(0.5), 10, "ascii").strip("\n") == "#####....."
