"""Orders and replies between the conductor and the processes of a run, and the process that keeps a broker.

1. Each process is spawned, ignores Ctrl-C, which the conductor handles, and ends when its pipe breaks.
2. The conductor asks and waits for each reply with a timeout; no process waits for a fixed time.
"""

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

from benchmarks.comparisons.transports.clients import program
from benchmarks.timing import cpu_seconds, free_port
from common.errors import LabanmeshError

TIMEOUT_S = 30.0
"""Enough for seventeen interpreters to start on two busy cores."""
POLL_S = 0.002
NO_USER_CHANGE = "user root"
"""Prevents mosquitto, when root starts it, from becoming another user; ignored otherwise."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class PublishOrder:
    """What a publisher puts from `begin_s` (time.monotonic) on: rate_hz messages per second, 0 for as fast as possible.

    timed: report when each is put. tick_s: how often to put everything that is due; 0 puts each message at its time.
    """

    begin_s: float
    seconds: float
    rate_hz: float = 0.0
    timed: bool = False
    tick_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Tally:
    """The messages of a process so far, the time of the reply, and the processor time of all its threads."""

    messages: int
    at_s: float
    cpu_s: float


class OrderReader:
    """The process's side: a thread reads orders, so that the loop need not. `messages` is reported in the Tally."""

    def __init__(self, pipe: Connection) -> None:
        self.messages = 0
        self.stopped = threading.Event()
        self.orders: SimpleQueue[PublishOrder] = SimpleQueue()
        self._pipe = pipe
        threading.Thread(target=self._read, daemon=True, name="orders").start()

    def reply(self, report: object) -> None:
        """Send a report to the conductor."""
        self._pipe.send(report)

    def _read(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while not self.stopped.is_set():
                order = self._pipe.recv()
                if isinstance(order, PublishOrder):
                    self.orders.put(order)
                elif order == "tally":
                    self.reply(Tally(self.messages, time.monotonic(), time.process_time()))
                else:
                    self.stopped.set()
            return
        os._exit(1)


@contextlib.contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Processes started within ignore Ctrl-C; the conductor receives it after the block, and ends the others."""
    received: list[int] = []
    # The first start would also start the resource tracker, which unblocks signals.
    resource_tracker.ensure_running()
    handler = signal.signal(signal.SIGINT, lambda number, _: received.append(number))
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        signal.signal(signal.SIGINT, handler)
        if received:
            signal.raise_signal(signal.SIGINT)


class Actor:
    """The conductor's side of one process; a context manager that ends it."""

    def __init__(self, work: Callable[..., None], *arguments: object) -> None:
        # Spawn: a child forked from a process with a Zenoh session hangs when it closes.
        spawn = multiprocessing.get_context("spawn")
        self._pipe, there = spawn.Pipe()
        self._process: Any = spawn.Process(target=work, args=(*arguments, there), daemon=True)
        self.name = str(arguments[0])
        self.started_ns = time.monotonic_ns()
        try:
            with _interrupts_blocked():
                self._process.start()
                there.close()
        except KeyboardInterrupt:
            # The process may have started, and only this object knows of it.
            self._pipe.close()
            self._end()
            raise

    def send(self, order: object) -> None:
        """Send an order without waiting for a reply."""
        with contextlib.suppress(OSError):
            self._pipe.send(order)

    def receive(self, kind: type[T], timeout_s: float = TIMEOUT_S) -> T:
        """The next reply; raises LabanmeshError without one of that type in time."""
        reply: object = None
        with contextlib.suppress(EOFError, OSError):
            reply = self._pipe.recv() if self._pipe.poll(timeout_s) else None
        if not isinstance(reply, kind):
            raise LabanmeshError(f"{self.name} ended early or hangs; its output above says why")
        return reply

    def tally(self) -> Tally:
        """Its counts so far."""
        self.send("tally")
        return self.receive(Tally)

    def stop(self, kind: type[T]) -> T:
        """Stop it and return its last report."""
        self.send("stop")
        return self.receive(kind)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # A stopped process ends by itself; the broken pipe ends any other.
        if kind is not None:
            self._pipe.close()
        self._end()
        self._pipe.close()

    def _end(self) -> None:
        if self._process.pid is None:
            return
        self._process.join(TIMEOUT_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def keep_broker(broker: str, processors: frozenset[int] | None, pipe: Connection) -> None:
    """Start `broker` on a free port, send `HOST:PORT`, reply with its Tally, end it at `stop` or a broken pipe."""
    if processors is not None:
        os.sched_setaffinity(0, processors)
    port = free_port()
    with tempfile.TemporaryDirectory() as place:
        running = subprocess.Popen(  # noqa: S603 - a program found by name, and words of ours
            _broker_command(broker, port, Path(place)),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            # Some brokers unblock Ctrl-C for themselves.
            start_new_session=True,
        )
        try:
            _wait_for_port(port, running)
            with contextlib.suppress(EOFError, OSError):
                pipe.send(f"127.0.0.1:{port}")
                while pipe.recv() == "tally":
                    pipe.send(Tally(0, time.monotonic(), cpu_seconds(running.pid)))
                pipe.send("ended")
        finally:
            running.terminate()
            running.wait()


def _broker_command(broker: str, port: int, place: Path) -> list[str]:
    path = program(broker) or broker
    if broker == "nats-server":
        return [path, "-a", "127.0.0.1", "-p", str(port)]
    configuration = place / "broker.conf"
    lines = (f"listener {port} 127.0.0.1", "allow_anonymous true", "set_tcp_nodelay true", NO_USER_CHANGE)
    configuration.write_text("\n".join([*lines, "persistence false", "log_type error"]) + "\n")
    return [path, "-c", str(configuration)]


def _wait_for_port(port: int, running: "subprocess.Popen[bytes]") -> None:
    pause, deadline = threading.Event(), time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline and running.poll() is None:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
            return
        pause.wait(POLL_S)
    raise SystemExit(f"{running.args!r} does not listen on port {port}")
