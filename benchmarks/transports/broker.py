"""A broker of one's own for a run, and the process that keeps it: it ends with the conductor, however that ends."""

import contextlib
import os
import socket
import subprocess
import tempfile
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path

from benchmarks.transports.kinds import program
from benchmarks.transports.orders import SOON_S, Tally

LOOK_S = 0.002
STAYS_ROOT = "user root"
"""mosquitto becomes another user when root starts it, and this line stops that; it is ignored otherwise."""


def keep(broker: str, processors: frozenset[int] | None, pipe: Connection) -> None:
    """Start `broker` on a free port, say `HOST:PORT`, tell its Tally when asked, end it at `stop` or a broken pipe."""
    if processors is not None:
        os.sched_setaffinity(0, processors)
    port = _free_port()
    with tempfile.TemporaryDirectory() as place:
        running = subprocess.Popen(  # noqa: S603 - a program found by name, and words of ours
            _command(broker, port, Path(place)),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            # Some brokers unblock Ctrl-C for themselves.
            start_new_session=True,
        )
        try:
            _await(port, running)
            with contextlib.suppress(EOFError, OSError):
                pipe.send(f"127.0.0.1:{port}")
                while pipe.recv() == "tally":
                    pipe.send(Tally(0, time.monotonic(), _cpu_s(running.pid)))
                pipe.send("ended")
        finally:
            running.terminate()
            running.wait()


def _command(broker: str, port: int, place: Path) -> list[str]:
    path = program(broker) or broker
    if broker == "nats-server":
        return [path, "-a", "127.0.0.1", "-p", str(port)]
    configuration = place / "broker.conf"
    lines = (f"listener {port} 127.0.0.1", "allow_anonymous true", "set_tcp_nodelay true", STAYS_ROOT)
    configuration.write_text("\n".join([*lines, "persistence false", "log_type error"]) + "\n")
    return [path, "-c", str(configuration)]


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _await(port: int, running: "subprocess.Popen[bytes]") -> None:
    pause, deadline = threading.Event(), time.monotonic() + SOON_S
    while time.monotonic() < deadline and running.poll() is None:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
            return
        pause.wait(LOOK_S)
    raise SystemExit(f"{running.args!r} does not listen on port {port}")


def _cpu_s(pid: int) -> float:
    """User and system time of a process, all threads."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
