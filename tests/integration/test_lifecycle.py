"""SIGTERM and Ctrl-C as a clean stop, in a process of its own."""

import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest
import typer
from processes import SOON_S

from common.lifecycle import stop_on_signals

SERVICE = """
import signal, sys, threading
from common.lifecycle import log_to_stderr, stop_on_signals
# As at a terminal: a shell that runs the tests in the background has Ctrl-C ignored for all of them.
signal.signal(signal.SIGINT, signal.default_int_handler)
log_to_stderr()
try:
    with stop_on_signals() as stop:
        print("up", flush=True)
        stop.wait()
        print("clean", flush=True)
        if len(sys.argv) > 1:
            threading.Event().wait()
except KeyboardInterrupt:
    sys.exit(130)
"""


@contextmanager
def started(*arguments):
    command = [sys.executable, "-c", SERVICE, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "up\n"
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 0), (signal.SIGINT, 130)])
def test_a_signal_stops_cleanly(number, status):
    with started() as process:
        process.send_signal(number)
        assert process.stdout.readline() == "clean\n"
        assert process.wait(SOON_S) == status


def test_a_search_that_the_end_of_the_time_stops_is_no_interruption():
    with pytest.raises(typer.Exit) as ended, stop_on_signals(0.01) as stop:
        stop.wait()
        raise KeyboardInterrupt
    assert ended.value.exit_code == 0
    with pytest.raises(KeyboardInterrupt), stop_on_signals():
        raise KeyboardInterrupt


def test_a_second_ctrl_c_acts_at_once():
    with started("hang") as process:
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "clean\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(SOON_S) == 130


STARTER = """
import os, subprocess, sys
environment = {**os.environ, "LABANMESH_SUPERVISOR": str(os.getpid())}
subprocess.Popen([sys.executable, "-c", sys.argv[1]], env=environment).wait()
"""


def test_a_process_ends_when_its_supervisor_is_killed():
    with subprocess.Popen([sys.executable, "-c", STARTER, SERVICE], stdout=subprocess.PIPE, text=True) as supervisor:
        assert supervisor.stdout.readline() == "up\n"
        supervisor.kill()
        # The service shares this stdout: it reports its clean end, and then the pipe closes.
        assert supervisor.stdout.read() == "clean\n"
