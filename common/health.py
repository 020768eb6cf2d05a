"""How a process is: what its status message says. Pure: time is passed in."""

import threading
from collections import deque
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from common.messages import Account, ProcessState, StatusMessage

SECOND_NS = 1_000_000_000
RATE_WINDOW_NS = 2 * SECOND_NS
"""Over how long the rate is counted: short enough to show a stall, long enough for a steady number."""


class Health:
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
        self._observers: dict[str, Account] | None = None
        self._lock = threading.Lock()

    def become(self, state: ProcessState, reason: str = "") -> None:
        """A new state, with its reason in words."""
        with self._lock:
            self._state, self._reason = state, reason

    def frame(self, frame_ns: int, now_ns: int) -> None:
        """One frame (for fusion: one posterior) captured at `frame_ns` was worked on at `now_ns`."""
        with self._lock:
            self._steps.append(now_ns)
            self._last_step_ns = now_ns
            self._last_frame_ns = max(frame_ns, self._last_frame_ns or 0)

    def skew(self, skew_s: float | None) -> None:
        """How far this machine's clock is ahead of the fusion machine's, in seconds; None: not known."""
        with self._lock:
            self._skew_s = skew_s

    def noticed(self, observers: Mapping[str, Account]) -> None:
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
