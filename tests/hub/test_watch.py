"""`labanmesh watch`: plain lines, lines of JSON, the picture on a terminal, and the verb over a real link."""

import io
import json
import os
import pty
import re
import subprocess
from pathlib import Path

import pytest
from processes import SOON_S
from processes import labanmesh as command
from rich.console import Console

import labanmesh
from common.wire import decode, encode
from hub.scene_state import SceneState
from hub.session import SceneUpdate
from hub.watch import BEGIN_FRAME, END_FRAME, StartNotice, show_json, show_lines, show_live

SIZES = ((80, 24), (120, 40), (50, 12), (200, 60), (30, 8), (80, 24))


def updates(make, *messages, step_s=0.1):
    state = SceneState("room").fold(make.vocabulary(), make.NOON)
    for place, message in enumerate(messages):
        now_ns = make.NOON + int(place * step_s * make.SECOND)
        before = state.at(now_ns)
        state = before.fold(message, now_ns) if message else before
        yield SceneUpdate(state, None if state is before else message)


def test_a_verdict_is_one_line_however_often_it_is_published(make, capsys):
    ended = make.verdict(1, ended_ns=make.NOON, at_ns=make.NOON + 1)
    show_lines(updates(make, make.verdict(1), ended, make.verdict(2)))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 and all("verdict  nthrow  1 of 2 agree  1.57 bits  cam1: ok" in line for line in lines)


def test_a_revision_is_a_line_of_its_own_and_not_a_second_movement(make, capsys):
    revised = make.verdict(1, stage="revised", revises="ok", at_ns=make.NOON + 1)
    ended = make.verdict(1, ended_ns=make.NOON, revises="ok", at_ns=make.NOON + 2)
    first = make.verdict(1, label="ok")
    show_lines(updates(make, first, first, revised, first, revised, ended, ended))
    lines = [line.partition("  ")[2] for line in capsys.readouterr().out.splitlines()]
    assert [line.split("  ")[:2] for line in lines] == [["verdict", "ok"], ["revised", "ok -> nthrow"]]


def test_the_score_of_an_ended_movement_is_a_line_once(make, capsys):
    remarks = ["left knee: 12 degrees too straight at 60 %"]
    ended = make.verdict(1, ended_ns=make.NOON, at_ns=make.NOON + 1, score=7.84, scores={"cam1": 7.84}, remarks=remarks)
    show_lines(updates(make, make.verdict(1), ended, ended))
    lines = [line.partition("  ")[2] for line in capsys.readouterr().out.splitlines()]
    assert lines[1:] == ["score  nthrow ended, 7.8 of 10; left knee: 12 degrees too straight at 60 %"]
    show_lines(updates(make, ended, ended))
    (line,) = capsys.readouterr().out.splitlines()
    assert "verdict  nthrow" in line and "7.8 of 10; left knee" in line
    show_json(updates(make, ended))
    (fields,) = map(json.loads, capsys.readouterr().out.splitlines())
    assert (fields["score"], fields["scores"], fields["remarks"]) == (7.84, {"cam1": 7.84}, remarks)


def test_a_line_says_why_there_is_no_verdict(make, capsys):
    lacks = "nthrow 79 % of the 80 % needed; 13 % something else"
    abstained = make.verdict(1, ended_ns=make.NOON, label="abstain", why=lacks)
    show_lines(updates(make, make.moving(why=lacks), abstained))
    undecided, verdict = capsys.readouterr().out.splitlines()
    assert undecided.endswith(f"  undecided: {lacks}")
    assert f"verdict  abstain  0 of 2 agree  1.57 bits  {lacks}" in verdict


def test_a_judgement_is_a_line_each_second_and_none_while_fusion_is_silent(make, capsys):
    judgements = [make.judgement(i, make.NOON + i * make.SECOND // 10) for i in range(25)]
    show_lines(updates(make, *judgements, *[None] * 50))
    lines = [line for line in capsys.readouterr().out.splitlines() if "judgement" in line]
    assert 3 <= len(lines) <= 4 and "cam2: nthrow 0.50" in lines[0]


def test_json_has_the_fields_of_the_wire_and_can_be_read_back(make, capsys):
    messages = [make.judgement(), make.status(), None, make.verdict()]
    show_json(updates(make, *messages))
    first, second = map(json.loads, capsys.readouterr().out.splitlines())
    assert (first.pop("kind"), second.pop("kind")) == ("judgement", "verdict")
    assert type(messages[0]).model_validate(first) == messages[0] == decode(type(messages[0]), encode(messages[0]))
    assert second["ended_ns"] is None and second["id"] == "v1"


def test_an_early_word_and_its_end_are_a_line_each(make, capsys):
    ended = make.verdict(1, ended_ns=make.NOON, label="ok")
    uncertain, first, second = make.moving(0, p=[0.25] * 4), make.moving(1, at_ns=make.NOON + 1), make.moving(2)
    show_lines(updates(make, uncertain, first, second, ended), 0.5)
    lines = [line.partition("  ")[2] for line in capsys.readouterr().out.splitlines()]
    early = [line for line in lines if line[:8] not in ("judgemen", "verdict ")]
    assert early == ["early  nthrow 60%", "corrected  ok, not nthrow"]
    show_json(updates(make, uncertain, first, ended), 0.5)
    kinds = [(each["kind"], each["label"]) for each in map(json.loads, capsys.readouterr().out.splitlines())]
    assert kinds[1:] == [("early", "nthrow"), ("judgement", "nthrow"), ("corrected", "ok"), ("verdict", "ok")]
    show_lines(updates(make, first, ended))
    assert "early" not in capsys.readouterr().out


def test_a_line_shows_how_the_movement_is_done(make, capsys):
    show_lines(updates(make, make.moving(facets={"effort_time": [0.1, 0.9]}, facing_deg=45.0, unlearned=0.25)))
    assert "something else 25%  sudden 90%, facing 45° left" in capsys.readouterr().out


def test_the_picture_leaves_the_verdicts_behind_and_the_screen_as_it_was(make):
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, width=80, height=24, legacy_windows=False)
    show_live(updates(make, make.judgement(), make.verdict(1)), console)
    opened, closed = "\x1b[?1049h", "\x1b[?1049l"
    picture, after = file.getvalue().split(closed)
    assert opened in picture and "cam1" in picture and "verdict  nthrow" in after


def test_every_picture_has_the_size_of_its_moment_and_appears_as_a_whole(make):
    console = Console(file=io.StringIO(), force_terminal=True, legacy_windows=False, color_system=None)
    *_, update = updates(make, make.judgement(), make.verdict(1))

    def resized():
        for step, size in enumerate(SIZES):
            console.size = size
            yield SceneUpdate(update.state.at(make.NOON + step * make.SECOND))

    show_live(resized(), console)
    written = console.file.getvalue()
    frames = re.findall(re.escape(BEGIN_FRAME) + "(.*?)" + re.escape(END_FRAME), written, re.DOTALL)
    assert len(frames) == len(SIZES) and "cam1" not in re.sub(r"(?s)\x1b\[\?2026h.*?\x1b\[\?2026l.*", "", written)
    for (width, height), frame in zip(SIZES, frames, strict=True):
        lines = re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", frame).split("\n")
        assert "\x1b[2J" not in frame, "a cleared screen flickers"
        assert len(lines) == height and {len(line) for line in lines} == {width}, (width, height)


def test_a_late_joiner_reads_the_last_judgement(fusion, scene_file, make, capsys):
    fusion.answer("laban/room/judgement", lambda: encode(make.judgement()))
    file = str(scene_file(fusion.locator))
    assert labanmesh.main(["watch", file, "--json", "--for", "0"]) == 0
    assert json.loads(capsys.readouterr().out)["label"] == "nthrow"
    assert labanmesh.main(["watch", file, "--for", "0"]) == 0
    assert "\x1b" not in capsys.readouterr().out, "not a terminal: plain lines"


@pytest.mark.parametrize(
    ("observers", "fusion", "line"),
    [
        ((), (), "received nothing from {}. Start the scene with: labanmesh up s.toml"),
        (("cam1",), (), "received no judgement from {}. Start fusion with: labanmesh fuse s.toml"),
        (
            (),
            ("fuse1",),
            "fusion runs in {}, and no observer that judges. Start cam1 with: labanmesh observe s.toml cam1",
        ),
        (
            ("cam1", "cam2"),
            ("fuse1",),
            "no observer of {} has learned a movement. Teach them with: labanmesh teach s.toml",
        ),
    ],
)
def test_one_line_says_what_is_missing_at_the_start(scene, make, observers, fusion, line):
    notice, state = StartNotice(scene, Path("s.toml")), SceneState("room", scene.roster, make.NOON)
    for role, names in (("observer", observers), ("fusion", fusion)):
        for name in names:
            state = state.fold(make.status(name), make.NOON, role)
    assert notice.text(state) == "", "it may come in a moment"
    later = state.at(make.NOON + 2 * make.SECOND)
    assert notice.text(later).startswith(line.format("scene room at tcp/127.0.0.1:7447"))
    assert notice.text(later.fold(make.judgement(), later.now_ns)) == ""


@pytest.mark.parametrize("words", [["watch"], ["count", "squat"]])
def test_when_nothing_is_received_one_line_is_on_stderr(scene_file, capsys, words):
    verb, *more = words
    assert labanmesh.main([verb, str(scene_file("tcp/127.0.0.1:9")), *more, "--for", "2"]) == 0
    output = capsys.readouterr()
    assert output.out == "" and output.err.count("\n") == 1 and "received nothing" in output.err


def test_on_a_terminal_the_notice_is_in_the_picture(scene_file):
    ours, theirs = pty.openpty()
    words = command("watch", scene_file("tcp/127.0.0.1:9"), "--for", "2")
    with subprocess.Popen(words, stdin=theirs, stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        written = b""
        # Reading from a terminal that its last process has closed is an error on Linux.
        while True:
            try:
                piece = os.read(ours, 65_536)
            except OSError:
                break
            written += piece
        assert process.wait(SOON_S) == 0
    os.close(ours)
    assert b"received nothing from scene room" in written


def test_output_that_cannot_be_written_is_one_line(fusion, scene_file, make):
    fusion.answer("laban/room/judgement", lambda: encode(make.judgement()))
    words = command("watch", scene_file(fusion.locator), "--json")
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, timeout=SOON_S, check=False)
    assert (result.returncode, result.stderr.count("\n")) == (1, 1), result.stderr
    assert "cannot write the output: no space left on device. Make room, or redirect it elsewhere" in result.stderr


@pytest.mark.parametrize("words", [["nowhere.toml"], [], ["x.toml", "--for", "-1"]])
def test_bad_input_is_one_line_and_status_2(words, capsys):
    assert labanmesh.main(["watch", *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
