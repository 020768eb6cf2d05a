"""The tally of a movement: live and final counts, revisions, targets, reset; and what `labanmesh count` prints."""

import io
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

import labanmesh
from hub.counting.commands import BELL, picture, show_counts, show_large
from hub.counting.tally import MovementTally, RepetitionTally, tally_words
from hub.scene_state import SceneState
from hub.session import SceneUpdate


@pytest.fixture
def tally(make):
    return RepetitionTally("ok", target=3, since_ns=make.NOON - make.SECOND)


def live(make, done, number=1, partial=None, label="ok"):
    return make.moving(1, number, label, repetitions=done, partial_repetitions=partial)


def test_the_count_in_progress_and_then_its_verdict(make, tally):
    for done in (1, 2, 2, 4):
        tally.update(live(make, done))
    assert tally.now.done == 4 and tally.reached == 1
    tally.update(make.verdict(1, label="ok", began_ns=make.NOON, ended_ns=make.NOON, repetitions=5))
    assert tally.now.done == 5
    tally.update(live(make, 1, number=2))
    assert tally.now.done == 6 and tally.reached == 2 and tally.now.is_complete


def test_what_is_not_repeated_counts_once_and_a_revision_takes_it_back(make, tally):
    tally.update(make.moving(1, 1, "ok"))
    tally.update(make.verdict(1, label="ok", began_ns=make.NOON))
    assert tally.now.done == 1
    tally.update(make.verdict(1, label="nthrow", began_ns=make.NOON, stage="revised", revises="ok"))
    assert tally.now.done == 0


def test_what_began_before_is_not_counted(make, tally):
    tally.update(make.verdict(1, label="ok", began_ns=make.NOON - 2 * make.SECOND, repetitions=7))
    assert tally.now.done == 0


def test_after_a_reset_the_movement_in_progress_counts_on_from_there(make, tally):
    tally.update(live(make, 4))
    tally.reset(target=10)
    assert tally.now == MovementTally("ok", target=10) and tally.reached == 0
    tally.update(live(make, 6))
    assert tally.now.done == 2


@given(st.lists(st.tuples(st.integers(1, 9), st.booleans()), min_size=1, max_size=90))
def test_the_total_is_the_sum_of_the_last_counts(make, bouts):
    tally = RepetitionTally("ok", since_ns=0)
    for number, (done, is_own) in enumerate(bouts):
        tally.update(live(make, done, number, label="ok" if is_own else "nthrow"))
    assert tally.now.done == sum(done for done, is_own in bouts if is_own)


@pytest.mark.parametrize(
    ("tally", "words"),
    [
        (MovementTally("ok", 8, 2), "8, 2 of them partial"), (MovementTally("ok", 8, 0, 10), "8 of 10"),
        (MovementTally("ok", 10, 0, 10), "10 of 10"), (MovementTally("ok", 12, 12, 10), "2 of 10, set 2, all partial"),
        (MovementTally("ok"), "0"), (MovementTally("ok", 1, 1), "1, all partial"),
    ],
)  # fmt: skip
def test_a_tally_in_words(tally, words):
    assert tally_words(tally) == words


def test_lines_and_json(make, tally, capsys):
    state = SceneState("room").fold(make.vocabulary(), make.NOON)
    old = SceneUpdate(state, live(make, 9, number=7), answered=True)
    updates = [old, *(SceneUpdate(state, live(make, done, partial=done - 1 or None)) for done in (1, 2, 2, 3))]
    show_counts(updates, tally)
    lines = capsys.readouterr().out.splitlines()
    assert lines == ["ok: 1 of 3", "ok: 2 of 3, 1 of them partial", "ok: 3 of 3, 2 of them partial", "target reached"]
    show_counts(updates, RepetitionTally("ok", 3, 0), as_json=True)
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["kind"] for row in rows] == ["count", "count", "count", "target"]
    assert rows[-1]["count"] == 3 and rows[-1]["partial"] == 2 and rows[-1]["sets"] == 1


def test_on_a_terminal_the_bell_rings_at_the_target_and_the_count_stays_as_a_line(make, tally, capsys):
    console = Console(width=40, height=12, force_terminal=True, file=io.StringIO())
    state = SceneState("room").fold(make.vocabulary(), make.NOON)
    show_large((SceneUpdate(state, live(make, done)) for done in (1, 2, 2, 3, 4)), tally, console)
    assert console.file.getvalue().count(BELL) == 1 and "1 of 3" in console.file.getvalue()
    assert capsys.readouterr().out == "ok: 1 of 3, set 2\n"


@pytest.mark.parametrize(("width", "height"), [(80, 24), (20, 6), (200, 60)])
def test_the_picture_fits_and_shows_the_number(width, height):
    console = Console(width=width, height=height, record=True, force_terminal=True, file=io.StringIO())
    console.print(picture(MovementTally("deep_squat", 8, 2, 10), width, height), height=height)
    text = console.export_text()
    assert len(text.splitlines()) <= height and "8 of 10, 2 of them partial" in " ".join(text.split())


@pytest.mark.parametrize(
    ("options", "rule"),
    [(["squat"], "'squat' is no movement of room"), (["ok", "--once"], "--once: there is no target")],
)
def test_bad_input_is_one_line(scene_file, options, rule, capsys):
    file = scene_file()
    file.write_text('vocabulary = ["ok", "wave"]\n' + file.read_text())
    assert labanmesh.main(["count", str(file), *options]) == 2
    assert rule in capsys.readouterr().err
