"""Whether a process is alive and ready, as /healthz and /readyz answer. Pure: time is passed in.

1. Alive: its loop has taken a step lately. Who is not alive hangs, and only a new process helps.
2. Ready: it does now what it is there for: frames come, the scene is judged, the broker is connected. Who is not ready
   says why, and may become ready by itself.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Role = Literal["observer", "fusion", "hub"]
STEPS: dict[Role, str] = {"observer": "frame", "fusion": "step", "hub": "look"}
"""What a step of the loop is called, by role."""
STALLED_S = 30.0
"""A loop without a step for so long hangs; the container files and systemd's watchdog of fusion wait as long."""
FRESH_S = 2.0
"""A process without a step for so long is not ready; the status message says degraded after as long."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Yes or no, and in words why; "" when all is well and there is nothing to add."""

    ok: bool
    reason: str


class Vitals:
    """Written by a process's loop, read by the thread that answers. now_s: seconds, never set back.

    fresh_s: how long ready lasts without a step. note: what the process says of itself, e.g. its status' reason.
    """

    def __init__(
        self,
        scene: str,
        role: Role,
        process: str,
        now_s: float,
        fresh_s: float = FRESH_S,
        note: Callable[[], str] = str,
    ) -> None:
        self.scene, self.role, self.process = scene, role, process
        self._fresh_s, self._note = fresh_s, note
        self._began_s = now_s
        self._stepped_s: float | None = None
        self._hindrance = ""

    def stepped(self, now_s: float) -> None:
        """The loop has taken a step: a frame, a judgement, a look into the inbox."""
        self._stepped_s = now_s

    def hindered(self, reason: str) -> None:
        """What keeps it from its work although its loop goes on; "" when nothing does any more."""
        self._hindrance = reason

    def alive(self, now_s: float) -> Answer:
        """Whether the loop goes on; a process that has just begun has time until its first step."""
        quiet_s = now_s - (self._began_s if self._stepped_s is None else self._stepped_s)
        return Answer(quiet_s < STALLED_S, self._quiet(quiet_s) if quiet_s >= STALLED_S else "")

    def ready(self, now_s: float) -> Answer:
        """Whether it does its work now."""
        if self._hindrance:
            return Answer(False, self._hindrance)
        note = self._note()
        if self._stepped_s is None:
            return Answer(False, note or f"no {STEPS[self.role]} yet")
        quiet_s = now_s - self._stepped_s
        fresh = quiet_s < self._fresh_s
        return Answer(fresh, note if fresh else note or self._quiet(quiet_s))

    def _quiet(self, quiet_s: float) -> str:
        return f"no {STEPS[self.role]} for {quiet_s:.0f} s"
