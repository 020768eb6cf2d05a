"""Progress: a bar on a terminal, a few plain lines elsewhere, nothing on stdout."""

import io
import sys

import pytest

from common.progress import LINES, ProgressBar


class Terminal(io.StringIO):
    def isatty(self):
        return True


def lines_of(capsys):
    out, err = capsys.readouterr()
    assert out == ""
    return err.splitlines()


def test_a_long_task_prints_a_few_lines_and_its_end(capsys):
    with ProgressBar() as bar:
        for n in range(1001):
            bar("judging", n, 1000)
    assert lines_of(capsys) == [f"judging: {n} of 1000" for n in (250, 500, 750, 1000)]


@pytest.mark.parametrize("total", [1, 2, 3, 7, 10_000])
def test_the_number_of_lines_is_limited_and_the_last_is_printed(capsys, total):
    with ProgressBar() as bar:
        for n in range(1, total + 1):
            bar("learning", n, total)
    lines = lines_of(capsys)
    assert len(lines) <= LINES and lines[-1] == f"learning: {total} of {total}"


def test_each_task_has_its_own_lines_and_may_start_again(capsys):
    with ProgressBar() as bar:
        for what in ("learning", "judging", "learning"):
            for n in (1, 2):
                bar(what, n, 2)
    assert lines_of(capsys) == [f"{what}: {n} of 2" for what in ("learning", "judging", "learning") for n in (1, 2)]


def test_an_empty_task_prints_nothing(capsys):
    with ProgressBar() as bar:
        bar("judging", 0, 0)
    assert lines_of(capsys) == []


def test_a_terminal_shows_a_bar(monkeypatch, capsys):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    with ProgressBar() as bar:
        bar("learning", 1, 2)
        bar("judging", 1, 4)
        bar("learning", 2, 2)
        tasks = {task.description: (task.completed, task.total) for task in bar._rich.tasks}
    assert tasks == {"learning": (2, 2), "judging": (1, 4)}
    assert "learning: " not in terminal.getvalue() and capsys.readouterr().out == ""


def test_a_bar_ends_if_the_work_fails(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with pytest.raises(RuntimeError, match="work"), ProgressBar() as bar:
        bar("learning", 1, 2)
        raise RuntimeError("work")
    assert bar._rich.finished is False and not bar._rich.live.is_started
