"""How a process is: what its status message says. Pure: time is passed in."""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from types import TracebackType
from typing import Self

from common import SECOND_NS
from common.errors import LabanmeshError
from common.messages import ObserverStatistics, ProcessState, StatusMessage
from common.notify import Notifier
from common.subsession import SubSession
from common.wire import encode

RATE_WINDOW_NS = 2 * SECOND_NS
"""Over how long the rate is counted: short enough to show a stall, long enough for a steady number."""


class ProcessStatus:
    """State, reason, frame rate and newest frame of one process; written by its loop, read by the status thread.

    A running process of which no frame was seen for `silence_s` says degraded of itself: being reachable does not
    mean that the camera delivers.
    """

    def __init__(self, scene: str, process: str, silence_s: float = 2.0) -> None:
        self._scene, self._process, self._silence_ns = scene, process, silence_s * SECOND_NS
        self._state: ProcessState = "starting"
        self._reason = ""
        self._steps: deque[int] = deque(maxlen=10_000)
        self._last_frame_ns: int | None = None
        self._last_step_ns: int | None = None
        self._skew_s: float | None = None
        self._observers: dict[str, ObserverStatistics] | None = None
        self._lock = threading.Lock()

    def set_state(self, state: ProcessState, reason: str = "") -> None:
        """A new state, with its reason in words."""
        with self._lock:
            self._state, self._reason = state, reason

    def record_frame(self, frame_ns: int, now_ns: int) -> None:
        """One frame (for fusion: one posterior) captured at `frame_ns` was worked on at `now_ns`."""
        with self._lock:
            self._steps.append(now_ns)
            self._last_step_ns = now_ns
            self._last_frame_ns = max(frame_ns, self._last_frame_ns or 0)

    def set_clock_skew(self, skew_s: float | None) -> None:
        """How far this machine's clock is ahead of the fusion machine's, in seconds; None: not known."""
        with self._lock:
            self._skew_s = skew_s

    def set_observers(self, observers: Mapping[str, ObserverStatistics]) -> None:
        """What a fusion service has noticed of its observers so far."""
        with self._lock:
            self._observers = dict(observers)

    def status(self, now_ns: int) -> StatusMessage:
        """What to say at `now_ns`; rate_hz counts the frames of the last two seconds."""
        with self._lock:
            while self._steps and now_ns - self._steps[0] > RATE_WINDOW_NS:
                self._steps.popleft()
            state, reason = self._judged(now_ns)
            return StatusMessage(
                scene=self._scene,
                id=self._process,
                state=state,
                reason=reason,
                rate_hz=len(self._steps) * SECOND_NS / RATE_WINDOW_NS,
                last_frame_ns=self._last_frame_ns,
                skew_s=self._skew_s,
                version=_version(),
                at_ns=now_ns,
                observers=self._observers,
            )

    def _judged(self, now_ns: int) -> tuple[ProcessState, str]:
        if self._state != "running" or self._last_step_ns is None:
            return self._state, self._reason
        # By this machine's clock: a peer whose clock is wrong is not silent.
        silent_ns = now_ns - self._last_step_ns
        if silent_ns <= self._silence_ns:
            return self._state, self._reason
        return "degraded", f"no frame for {silent_ns / SECOND_NS:.0f} s"


@cache
def _version() -> str:
    try:
        return version("labanmesh")
    except PackageNotFoundError:
        return ""


class StatusPublisher:
    """Publishes a process's health under its status key; a context manager that says starting and stopping.

    It has a thread of its own, because a process whose camera hangs must still be able to say so.
    """

    def __init__(
        self,
        link: SubSession,
        key: str,
        health: ProcessStatus,
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

    def set_state(self, state: ProcessState, reason: str = "") -> None:
        """A change of state, said at once."""
        self._health.set_state(state, reason)
        self.publish()

    def alive(self) -> None:
        """A frame, or a step, was worked on. A supervisor that hears none for long starts the process anew."""
        self._supervisor.alive()

    def publish(self) -> None:
        """How the process is now; who enters the board as a context has it said each second."""
        status = self._health.status(self._clock())
        self._supervisor.status(": ".join(filter(None, (status.state, status.reason))))
        self._publisher.put(encode(status))

    def _payload(self) -> bytes:
        return encode(self._health.status(self._clock()))

    def _repeat(self) -> None:
        while not self._ended.wait(self._every_s):
            try:
                self.publish()
            except LabanmeshError:
                return  # the link was closed under us: nobody can be told any more

    def __enter__(self) -> Self:
        self.set_state("starting")
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
            self.set_state("stopping")
        else:
            self.set_state("failed", f"{type(error).__name__}: {error}"[:200])
