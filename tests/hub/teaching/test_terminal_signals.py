"""What a teacher sees and hears in a terminal: large letters, lines above them, beeps, keys."""

import sys
import threading

import pytest

from hub.teaching import terminal
from hub.teaching.big_letters import big
from hub.teaching.interface import GO, Action, Step
from hub.teaching.terminal import Terminal


@pytest.fixture
def screen(monkeypatch, capsys):
    monkeypatch.setattr(type(sys.stdout), "isatty", lambda self: True)
    monkeypatch.setattr(terminal.shutil, "get_terminal_size", lambda: terminal.shutil.os.terminal_size((80, 24)))
    monkeypatch.setattr(terminal, "BEEP_S", 0.0)
    return lambda: capsys.readouterr().out


@pytest.mark.parametrize("text", ["3", "NOW", "kept"])
def test_letters_are_as_large_as_fit(text):
    rows = big(text, 200, 20)
    assert len(rows) == 20 and max(map(len, rows)) > 20 * len(text) and set("".join(rows)) == {"█", " "}
    assert len(big(text, 40, 7)) == 5 and big(text, 5, 20) == [] and big("", 80, 24) == []


def test_a_countdown_is_large_and_beeps_and_lines_stay_above_it(screen):
    interface = Terminal(threading.Event(), None, keyboard=False)
    for left in (2, 1):
        interface.show(Step("countdown", "wave", 1, 5, left_s=left))
    interface.show(Step("now", "wave", 1, 5))
    interface.show(Step("kept", "wave", 1, 5))
    shown = screen()
    assert shown.count("\a") == 1 + 1 + 2 + 1 and "█" in shown and "wave 1 of 5: now" in shown
    interface.say("wave 1 of 5: kept by sofa (1.9 s)")
    removed = screen()
    assert removed.endswith("\x1b[Jwave 1 of 5: kept by sofa (1.9 s)\n") and "A\x1b[J" in removed
    interface.say("next")
    assert "A\x1b[J" not in screen(), "only what changes is removed"


def test_without_a_terminal_there_are_lines_and_no_beeps(capsys):
    interface = Terminal(threading.Event(), None, keyboard=False)
    interface.show(Step("countdown", "wave", 1, 5, left_s=1)), interface.show(Step("now", "wave", 1, 5))
    assert capsys.readouterr().out == "wave 1 of 5: now\n"


@pytest.mark.parametrize(
    ("kind", "key", "action"),
    [("waiting", " ", Action("begin")), ("now", "r", Action("repeat")), ("doubt", "d", Action("drop")),
     ("alarms", "s", Action("skip")), ("other", "r", GO), ("now", "x", GO)],
)  # fmt: skip
def test_what_keys_mean(monkeypatch, kind, key, action):
    interface = Terminal(threading.Event(), None, keyboard=True)
    monkeypatch.setattr(terminal.select, "select", lambda *_: ([sys.stdin], [], []))
    monkeypatch.setattr(sys, "stdin", type("Keys", (), {"read": lambda self, count: key.upper()})())
    assert interface.between(Step(kind, "wave"), 1.0) == action


@pytest.mark.parametrize(
    ("line", "bare"),
    [
        ("wave: stand still to begin; or press a key", "wave: stand still to begin"),
        ("now 0.5 minutes of anything: each verdict is a false alarm (s: skip)", "each verdict is a false alarm\n"),
        ("2 people in the picture of sofa: is the take yours? r makes it again", "is the take yours?\n"),
    ],
)
def test_keys_are_named_only_where_there_is_a_keyboard(capsys, line, bare):
    Terminal(threading.Event(), None, keyboard=True).say(line)
    assert line in capsys.readouterr().out
    Terminal(threading.Event(), None, keyboard=False).say(line)
    output = capsys.readouterr().out
    assert bare in output and "key" not in output and "r makes" not in output
