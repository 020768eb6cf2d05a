"""Fixtures of the observer's tests."""

import errno

import pytest
import typer

import labanmesh
from observer import files


@pytest.fixture
def run(capsys):
    """Run `labanmesh` with these words; returns the exit status and what was printed to stdout and stderr."""

    def call(*words):
        status = labanmesh.main([str(word) for word in words])
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    return call


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    """Make a runner of one command in an empty folder, which returns the output and lets errors pass."""
    monkeypatch.chdir(tmp_path)

    def of(function):
        app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        app.command(function.__name__)(function)
        main = typer.main.get_command(app).main

        def call(*words):
            main([str(word) for word in words], f"labanmesh {function.__name__}", standalone_mode=False)
            return capsys.readouterr().out

        return call

    return of


@pytest.fixture
def full_disk(monkeypatch):
    """Make a disk full, until the test undoes it."""

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    return lambda: monkeypatch.setattr(files.os, "fsync", full)
