"""The status of a process, and its publication: at every change, each second, and in answer to queries."""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Self

from common import SECOND_NS
from common.errors import LabanmeshError
from common.message_types import BodyRegionShares
from common.messages import ObserverStatistics, ProcessState, StatusMessage
from common.notify import Notifier
from common.subsession import SubSession
from common.wire import encode

REASON_LIMIT = 200
"""Characters of a reason: more would not help a person, and a status must fit into a message."""
STATUS_EVERY_S = 1.0
"""Seconds between two publications of a status."""
RATE_WINDOW_NS = 2 * SECOND_NS
"""Frames are counted over this time: short enough to show a stall, long enough for a steady rate."""


class ProcessStatus:
    """State, reason, frame rate and newest frame of one process; written by its loop, read by the status thread.

    A running process without a frame for `silence_s` reports that it is degraded: a process can be reachable while its
    camera is not. The time is passed in.
    """

    def __init__(self, scene: str, process: str, silence_s: float = 2.0) -> None:
        self._scene, self._process, self._silence_ns = scene, process, silence_s * SECOND_NS
        self._state: ProcessState = "starting"
        self._reason = ""
        self._steps: deque[int] = deque(maxlen=10_000)
        self._last_frame_ns: int | None = None
        self._last_step_ns: int | None = None
        self._lock = threading.Lock()
        self.clock_skew_s: float | None = None
        """How far this machine's clock is ahead of the fusion machine's; None if unknown."""
        self.session: str | None = None
        """Random per process; None: not published."""
        self.observers: dict[str, ObserverStatistics] | None = None
        """A fusion service's statistics of its observers."""
        self.leans_on: BodyRegionShares | None = None
        """The regions of the body that an observer's model leans on."""

    def set_state(self, state: ProcessState, reason: str = "") -> None:
        """Set the state, with its reason in words."""
        with self._lock:
            self._state, self._reason = state, reason[:REASON_LIMIT]

    def record_frame(self, frame_ns: int, now_ns: int) -> None:
        """Count one frame (for fusion: one posterior), captured at `frame_ns` and processed at `now_ns`."""
        self.record_frames((frame_ns,), now_ns)

    def record_frames(self, frames_ns: Sequence[int], now_ns: int) -> None:
        """Count several frames at once, at least one."""
        with self._lock:
            self._steps.extend([now_ns] * len(frames_ns))
            self._last_step_ns = now_ns
            self._last_frame_ns = max(*frames_ns, self._last_frame_ns or 0)

    def status(self, now_ns: int) -> StatusMessage:
        """The status message at `now_ns`; rate_hz counts the frames of the last two seconds."""
        with self._lock:
            while self._steps and now_ns - self._steps[0] > RATE_WINDOW_NS:
                self._steps.popleft()
            state, reason = self._current_state(now_ns)
            return StatusMessage(
                scene=self._scene,
                id=self._process,
                state=state,
                reason=reason,
                rate_hz=len(self._steps) * SECOND_NS / RATE_WINDOW_NS,
                last_frame_ns=self._last_frame_ns,
                skew_s=self.clock_skew_s,
                version=_version(),
                at_ns=now_ns,
                session=self.session,
                observers=self.observers,
                leans_on=self.leans_on,
            )

    def _current_state(self, now_ns: int) -> tuple[ProcessState, str]:
        if self._state != "running" or self._last_step_ns is None:
            return self._state, self._reason
        # By this machine's clock, because a peer whose clock is wrong is not silent.
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
    """Publishes a process's status under its key; a context manager that sets the states starting and stopping.

    It has a thread of its own, so that a process whose camera hangs still reports it.
    """

    def __init__(
        self,
        link: SubSession,
        key: str,
        status: ProcessStatus,
        clock: Callable[[], int] = time.time_ns,
        supervisor: Notifier | None = None,
    ) -> None:
        self._publisher = link.publisher(key)
        self._status, self._clock = status, clock
        self._supervisor = supervisor or Notifier.from_environment()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._repeat, name="status", daemon=True)
        link.answer(key, self._payload)

    def set_state(self, state: ProcessState, reason: str = "") -> None:
        """Change the state and publish it at once."""
        self._status.set_state(state, reason)
        self.publish()

    def alive(self) -> None:
        """Tell the supervisor that work was done; it restarts a process that has been silent for long."""
        self._supervisor.alive()

    def publish(self) -> None:
        """Publish the present status; as a context manager this happens each second."""
        status = self._status.status(self._clock())
        self._supervisor.status(": ".join(filter(None, (status.state, status.reason))))
        self._publisher.put(encode(status))

    def _payload(self) -> bytes:
        return encode(self._status.status(self._clock()))

    def _repeat(self) -> None:
        while not self._ended.wait(STATUS_EVERY_S):
            try:
                self.publish()
            except LabanmeshError:
                return  # the link is closed: nobody can receive a status any more

    def __enter__(self) -> Self:
        self.set_state("starting")
        self._thread.start()
        self._supervisor.ready()
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        self._ended.set()
        self._thread.join()
        self._supervisor.stopping()
        if error is None:
            self.set_state("stopping")
        else:
            self.set_state("failed", f"{type(error).__name__}: {error}")
