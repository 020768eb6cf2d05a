"""Saying on the mesh how a process is: at every change, each second, and to whoever asks."""

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from common.branch import Branch
from common.errors import LabanmeshError
from common.health import Health
from common.messages import ProcessState
from common.notify import Notifier
from common.wire import encode


class StatusBoard:
    """Publishes a process's health under its status key; a context manager that says starting and stopping.

    It has a thread of its own, because a process whose camera hangs must still be able to say so.
    """

    def __init__(
        self,
        link: Branch,
        key: str,
        health: Health,
        clock: Callable[[], int] = time.time_ns,
        every_s: float = 1.0,
        supervisor: Notifier | None = None,
    ) -> None:
        self._publisher = link.publisher(key)
        self._health, self._clock, self._every_s = health, clock, every_s
        self._supervisor = supervisor or Notifier.from_environment()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._repeat, name="status", daemon=True)
        link.answer(key, self._payload)

    def become(self, state: ProcessState, reason: str = "") -> None:
        """A change of state, said at once."""
        self._health.become(state, reason)
        self.say()

    def alive(self) -> None:
        """A frame, or a step, was worked on. A supervisor that hears none for long starts the process anew."""
        self._supervisor.alive()

    def say(self) -> None:
        """How the process is now; who enters the board as a context has it said each second."""
        status = self._health.status(self._clock())
        self._supervisor.status(": ".join(filter(None, (status.state, status.reason))))
        self._publisher.put(encode(status))

    def _payload(self) -> bytes:
        return encode(self._health.status(self._clock()))

    def _repeat(self) -> None:
        while not self._ended.wait(self._every_s):
            try:
                self.say()
            except LabanmeshError:
                return  # the link was closed under us: nobody can be told any more

    def __enter__(self) -> Self:
        self.become("starting")
        self._thread.start()
        self._supervisor.ready()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        self._supervisor.stopping()
        if error is None:
            self.become("stopping")
        else:
            self.become("failed", f"{type(error).__name__}: {error}"[:200])
