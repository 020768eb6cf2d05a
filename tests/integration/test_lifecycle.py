"""SIGTERM and Ctrl-C as a clean stop, in a process of its own."""

import signal
import subprocess
import sys

import pytest

SERVICE = """
import sys
from common.lifecycle import log_to_stderr, stop_on_signals
log_to_stderr()
try:
    with stop_on_signals() as stop:
        print("up", flush=True)
        stop.wait()
        print("clean", flush=True)
        if len(sys.argv) > 1:
            stop.clear()
            stop.wait()
except KeyboardInterrupt:
    sys.exit(130)
"""


def start(*arguments):
    process = subprocess.Popen([sys.executable, "-c", SERVICE, *arguments], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "up\n"
    return process


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 0), (signal.SIGINT, 130)])
def test_a_signal_stops_cleanly(number, status):
    with start() as process:
        process.send_signal(number)
        assert process.stdout.readline() == "clean\n"
        assert process.wait(10) == status


def test_a_second_ctrl_c_acts_at_once():
    with start("hang") as process:
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "clean\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 130
