"""Progress: few plain lines where nobody watches, a bar on a terminal, never on stdout."""

import io
import sys

import pytest

from common.progress import LINES, ProgressBar


class Terminal(io.StringIO):
    def isatty(self):
        return True


def said(capsys):
    out, err = capsys.readouterr()
    assert out == ""
    return err.splitlines()


def test_a_long_task_says_a_few_lines_and_its_end(capsys):
    with ProgressBar() as bar:
        for n in range(1001):
            bar("judging", n, 1000)
    assert said(capsys) == [f"judging: {n} of 1000" for n in (250, 500, 750, 1000)]


@pytest.mark.parametrize("total", [1, 2, 3, 7, 10_000])
def test_never_more_than_so_many_lines_and_always_the_last(capsys, total):
    with ProgressBar() as bar:
        for n in range(1, total + 1):
            bar("learning", n, total)
    lines = said(capsys)
    assert len(lines) <= LINES and lines[-1] == f"learning: {total} of {total}"


def test_each_task_has_its_own_lines_and_may_begin_again(capsys):
    with ProgressBar() as bar:
        for what in ("learning", "judging", "learning"):
            for n in (1, 2):
                bar(what, n, 2)
    assert said(capsys) == [f"{what}: {n} of 2" for what in ("learning", "judging", "learning") for n in (1, 2)]


def test_nothing_to_do_is_no_division_by_zero(capsys):
    with ProgressBar() as bar:
        bar("judging", 0, 0)
    assert said(capsys) == []


def test_on_a_terminal_it_is_a_bar_that_goes_away(monkeypatch, capsys):
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


def test_a_bar_ends_when_the_work_fails(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with pytest.raises(RuntimeError, match="work"), ProgressBar() as bar:
        bar("learning", 1, 2)
        raise RuntimeError("work")
    assert bar._rich.finished is False and not bar._rich.live.is_started
