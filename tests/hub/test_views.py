"""Plain lines and lines of JSON: what a log and a program read. And the picture on a terminal."""

import io
import json

from rich.console import Console

from common.messages import OngoingMovement
from common.wire import decode, encode
from hub.scene_state import SceneState
from hub.session import SceneUpdate
from hub.watch import show_json, show_lines, show_live


def heard(said, *messages, step_s=0.1):
    state = SceneState("room").fold(said.vocabulary(), said.NOON)
    for place, message in enumerate(messages):
        now_ns = said.NOON + int(place * step_s * said.SECOND)
        state = state.at(now_ns).fold(message, now_ns) if message else state.at(now_ns)
        yield SceneUpdate(state, message)


def test_one_line_for_each_verdict_however_often_it_is_said(said, capsys):
    ended = said.verdict(1, ended_ns=said.NOON, at_ns=said.NOON + 1)
    show_lines(heard(said, said.verdict(1), ended, said.verdict(2)))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 and all("verdict  nthrow  1 of 2 agree  1.57 bits  cam1: ok" in line for line in lines)


def test_a_judgement_a_second_and_none_while_the_referee_is_silent(said, capsys):
    talking = [said.judgement(i, said.NOON + i * said.SECOND // 10) for i in range(25)]
    show_lines(heard(said, *talking, *[None] * 50))
    lines = [line for line in capsys.readouterr().out.splitlines() if "judgement" in line]
    assert 3 <= len(lines) <= 4 and "cam2: nthrow 0.50" in lines[0]


def test_json_has_the_wires_fields_and_can_be_read_back(said, capsys):
    messages = [said.judgement(), said.status(), None, said.verdict()]
    show_json(heard(said, *messages))
    first, second = map(json.loads, capsys.readouterr().out.splitlines())
    assert (first.pop("kind"), second.pop("kind")) == ("judgement", "verdict")
    assert type(messages[0]).model_validate(first) == messages[0] == decode(type(messages[0]), encode(messages[0]))
    assert second["ended_ns"] is None and second["id"] == "v1"


def going_on(said, seq, **more):
    movement = OngoingMovement(id="v1", began_ns=said.NOON)
    return said.judgement(seq, said.NOON + seq).model_copy(update={"movement": movement, **more})


def test_an_early_word_and_what_became_of_it_are_a_line_each(said, capsys):
    ended = said.verdict(1, ended_ns=said.NOON, label="ok")
    doubted = going_on(said, 0, p=[0.25] * 4)
    show_lines(heard(said, doubted, going_on(said, 1), going_on(said, 2), ended), 0.5)
    lines = [line.partition("  ")[2] for line in capsys.readouterr().out.splitlines()]
    assert [line for line in lines if line[:8] not in ("judgemen", "verdict ")] == [
        "early  nthrow 60%",
        "corrected  ok, not nthrow",
    ]
    show_json(heard(said, doubted, going_on(said, 1), ended), 0.5)
    kinds = [(each["kind"], each["label"]) for each in map(json.loads, capsys.readouterr().out.splitlines())]
    assert kinds[1:] == [("early", "nthrow"), ("judgement", "nthrow"), ("corrected", "ok"), ("verdict", "ok")]
    show_lines(heard(said, going_on(said, 1), ended))
    assert "early" not in capsys.readouterr().out


def test_a_line_says_how_it_is_done(said, capsys):
    how = {"facets": {"effort_time": [0.1, 0.9]}, "facing_deg": 45.0, "unlearned": 0.25}
    show_lines(heard(said, going_on(said, 1, **how)))
    assert "something else 25%  sudden 90%, facing 45° left" in capsys.readouterr().out


def test_the_picture_leaves_the_verdicts_behind_and_the_screen_as_it_was(said):
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, width=80, height=24, legacy_windows=False)
    show_live(heard(said, said.judgement(), said.verdict(1)), console)
    opened, closed = "\x1b[?1049h", "\x1b[?1049l"
    picture, after = file.getvalue().split(closed)
    assert opened in picture and "cam1" in picture and "verdict  nthrow" in after
