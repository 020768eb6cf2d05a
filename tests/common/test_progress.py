"""Progress: a bar on a terminal, a few plain lines elsewhere, nothing on stdout."""

import io
import sys
import threading

import pytest

from common.progress import ProgressBar


class Terminal(io.StringIO):
    def isatty(self):
        return True


def lines_of(capsys):
    out, err = capsys.readouterr()
    assert out == ""
    return err.splitlines()


@pytest.mark.parametrize(
    ("total", "printed"), [(0, []), (1, [1]), (3, [1, 2, 3]), (7, [2, 4, 6, 7]), (1000, [250, 500, 750, 1000])]
)
def test_a_task_prints_four_lines_at_most_and_its_end(capsys, total, printed):
    with ProgressBar() as bar:
        for n in range(total + 1):
            bar("judging", n, total)
    assert lines_of(capsys) == [f"judging: {n} of {total}" for n in printed]


def test_each_task_has_its_own_lines_and_may_start_again(capsys):
    with ProgressBar() as bar:
        for what in ("learning", "judging", "learning"):
            for n in (1, 2):
                bar(what, n, 2)
    assert lines_of(capsys) == [f"{what}: {n} of 2" for what in ("learning", "judging", "learning") for n in (1, 2)]


def test_a_task_that_takes_a_while_says_that_it_has_begun(monkeypatch, capsys):
    timers = []

    class Timer(threading.Timer):
        def start(self):
            timers.append(self)

    monkeypatch.setattr(threading, "Timer", Timer)
    with ProgressBar("reading") as bar:
        timers[-1].function(*timers[-1].args, **timers[-1].kwargs)
        assert lines_of(capsys) == ["reading"]
        bar("judging", 0, 8)
        bar("judging", 1, 8)
        assert len(timers) == 2 and timers[1].args == ("judging: 0 of 8",)
        bar("judging", 8, 8)
    assert all(timer.finished.is_set() for timer in timers)
    assert lines_of(capsys) == ["judging: 8 of 8"]


def test_a_terminal_shows_a_bar(monkeypatch, capsys):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    with ProgressBar("reading") as bar:
        assert "reading" in terminal.getvalue()
        bar("learning", 1, 2)
        bar("judging", 1, 4)
        bar("learning", 2, 2)
        tasks = {task.description: (task.completed, task.total) for task in bar._rich.tasks if task.visible}
    assert tasks == {"learning": (2, 2), "judging": (1, 4)}
    assert "learning: " not in terminal.getvalue() and capsys.readouterr().out == ""


def test_a_bar_ends_if_the_work_fails(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with pytest.raises(RuntimeError, match="work"), ProgressBar() as bar:
        bar("learning", 1, 2)
        raise RuntimeError("work")
    assert bar._rich.finished is False and not bar._rich.live.is_started
