"""`labanmesh teach --rehearse`: what the performer is asked for, and what is counted at the end."""

import signal
import subprocess
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

from common.errors import BadInput
from hub.teaching import commands, rehearsal
from hub.teaching.commands import TeachOptions
from hub.teaching.interface import Step
from hub.teaching.rehearsal import Rehearsal, RehearsalTerminal, rehearsed, show_recognition

LABELS = ("byebye", "point", "maestro")


class Performer:
    """A process that keeps what it is asked for."""

    def __init__(self):
        self.stdin, self.asked = self, []

    def write(self, text):
        self.asked += [line for line in text.splitlines() if line]

    def flush(self):
        pass


@pytest.fixture
def acted():
    return Rehearsal(Path("scene.toml"), LABELS, {}, Performer())


def test_the_performer_does_what_the_screen_asks_each_take_anew(acted, capsys):
    screen = RehearsalTerminal(acted, threading.Event(), None, keyboard=False)
    for kind in ("waiting", "countdown", "now", "kept", "countdown", "now", "kept", "other", "other", "learning"):
        screen.show(Step(kind, "" if kind == "other" else "point"))
    assert acted.process.asked == ["rest", "act point", "rest", "act point", "rest", "live", "rest"]


def test_after_the_lesson_movements_are_counted_while_watch_shows_them(acted, monkeypatch):
    view, lines = [], []

    @contextmanager
    def shown(command):
        view.append(command[3:])
        yield type("View", (), {"send_signal": lambda self, number: view.append(number), "wait": lambda self, s: 0})()

    monkeypatch.setattr(subprocess, "Popen", shown)
    words = iter(["right"] * 4 + ["", "abstain"])

    def next_verdict(interface):
        word, label = next(words), acted.process.asked[-1].removeprefix("act ")
        return label if word == "right" else word

    monkeypatch.setattr(rehearsal, "next_verdict", next_verdict)
    interface = type("Screen", (), {"pause": lambda self, s: None, "say": lambda self, line: lines.append(line)})()
    show_recognition(acted, interface)
    assert sorted(acted.process.asked[1:]) == sorted(f"act {label}" for label in LABELS * 2)
    assert view == [["labanmesh", "watch", "scene.toml"], signal.SIGTERM]
    assert "the performer did 6 movements; 4 recognised" in lines
    assert sum("nothing was decided" in line for line in lines) == 1
    assert "labanmesh up scene.toml" in lines[-1] and "labanmesh init" in lines[-1]


def test_a_movement_that_the_performer_does_not_know_is_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with (
        pytest.raises(BadInput, match=r"^juggle: the performer .* known: lunging, .*$"),
        rehearsed(["byebye", "juggle"]),
    ):
        pytest.fail("there is no performer")
    assert not list(tmp_path.iterdir())


def test_a_rehearsal_is_shorter_where_nothing_else_is_typed():
    short, usual = (commands._plan(TeachOptions(labels=["a", "b"], rehearse=each)) for each in (True, False))
    assert (usual.takes, usual.background_s, usual.alarm_s, usual.countdown) == (5, 120.0, 30.0, 3)
    assert short.takes < usual.takes and short.background_s < usual.background_s
    typed = commands._plan(TeachOptions(rehearse=True, takes=7, background_minutes=0, alarm_minutes=2, countdown=0))
    assert (typed.takes, typed.background_s, typed.alarm_s, typed.countdown) == (7, 0, 120, 0)


@pytest.mark.parametrize(
    ("options", "line"),
    [(TeachOptions(), r"name the scene file, e\.g\. .* labanmesh teach --rehearse"),
     (TeachOptions(rehearse=True, was=["last"]), "--rehearse: is a lesson")],
)  # fmt: skip
def test_what_is_missing_or_does_not_fit_is_one_line(options, line):
    with pytest.raises(BadInput, match=line):
        commands.teach.__wrapped__(options)
