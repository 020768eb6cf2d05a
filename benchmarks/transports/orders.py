"""Orders and replies between the conductor and the processes of a run, and how a process ends."""

import contextlib
import multiprocessing
import os
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import Any, Self, TypeVar

from benchmarks.transports.kinds import program
from common.errors import LabanmeshError

SOON_S = 30.0
"""Long enough for seventeen interpreters to start on two busy cores."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Plan:
    """What a publisher is to put, from `begin_s` (time.monotonic) on: rate_hz a second, or, at 0, as fast as it can.

    noted: when each is put is told. tick_s: how often it puts what is due by then; 0 is each message at its time.
    """

    begin_s: float
    seconds: float
    rate_hz: float = 0.0
    noted: bool = False
    tick_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Tally:
    """What a process has done so far: messages, when it says so, and what all its threads have cost."""

    messages: int
    at_s: float
    cpu_s: float


class Orders:
    """The process's side: a thread that reads orders, so that the loop need not look. `messages` is told by Tally."""

    def __init__(self, pipe: Connection) -> None:
        self.messages = 0
        self.stopped = threading.Event()
        self.plans: SimpleQueue[Plan] = SimpleQueue()
        self._pipe = pipe
        threading.Thread(target=self._read, daemon=True, name="orders").start()

    def say(self, account: object) -> None:
        """Tell the conductor."""
        self._pipe.send(account)

    def tally(self) -> Tally:
        """So far."""
        return Tally(self.messages, time.monotonic(), time.process_time())

    def _read(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while not self.stopped.is_set():
                order = self._pipe.recv()
                if isinstance(order, Plan):
                    self.plans.put(order)
                elif order == "tally":
                    self.say(self.tally())
                else:
                    self.stopped.set()
            return
        os._exit(1)


@contextlib.contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """What is started within never hears Ctrl-C; for the conductor, who lets the others end, it waits until after."""
    came: list[int] = []
    # The first start would also start the tracker of resources, which unblocks what is blocked here.
    resource_tracker.ensure_running()
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)


class Actor:
    """The conductor's side of one process; a context manager that ends it."""

    def __init__(self, work: Callable[..., None], *arguments: object) -> None:
        # Spawn: a child forked from a process with a Zenoh session hangs when it closes.
        spawn = multiprocessing.get_context("spawn")
        self._pipe, there = spawn.Pipe()
        self._process: Any = spawn.Process(target=work, args=(*arguments, there), daemon=True)
        self.what = str(arguments[0])
        self.started_ns = time.monotonic_ns()
        try:
            with _deaf_to_interrupts():
                self._process.start()
                there.close()
        except KeyboardInterrupt:
            # It may have been started all the same, and nobody else knows of it yet.
            self._pipe.close()
            self._end()
            raise

    def tell(self, order: object) -> None:
        """An order that has no answer, or one that is waited for later."""
        with contextlib.suppress(OSError):
            self._pipe.send(order)

    def said(self, kind: type[T], timeout_s: float = SOON_S) -> T:
        """What it says next; raises LabanmeshError when it says nothing of that kind in time."""
        account: object = None
        with contextlib.suppress(EOFError, OSError):
            account = self._pipe.recv() if self._pipe.poll(timeout_s) else None
        if not isinstance(account, kind):
            raise LabanmeshError(f"{self.what} ended early or hangs; what it wrote above says why")
        return account

    def tally(self) -> Tally:
        """What it has done so far."""
        self.tell("tally")
        return self.said(Tally)

    def stop(self, kind: type[T]) -> T:
        """Its last account."""
        self.tell("stop")
        return self.said(kind)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # One that was stopped ends by itself; the broken pipe ends any other.
        if kind is not None:
            self._pipe.close()
        self._end()
        self._pipe.close()

    def _end(self) -> None:
        if self._process.pid is None:
            return
        self._process.join(SOON_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


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
