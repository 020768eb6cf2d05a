"""Runs looks beside each other, each in a thread, and waits for none longer than it may take."""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from deploy.doctor.finding import Finding, Group, warning


@dataclass(frozen=True, slots=True)
class Look:
    """One look that gives findings. group: where it is told that it broke or hung. limit_s: how long it may take."""

    group: Group
    limit_s: float
    run: Callable[[], Sequence[Finding]]


def all_at_once(looks: Sequence[Look]) -> list[Finding]:
    """What all of them found, in their order. One that breaks or hangs is a finding itself: doctor always answers."""
    began_s = time.monotonic()
    started = [_Started(look) for look in looks]
    found: list[Finding] = []
    for each in started:
        each.thread.join(max(0.0, began_s + each.look.limit_s - time.monotonic()))
        found += each.outcome()
    return found


class _Started:
    """A look that runs. Its thread is a daemon: one that hangs does not keep the process."""

    def __init__(self, look: Look) -> None:
        self.look = look
        self._found: Sequence[Finding] | None = None
        self.thread = threading.Thread(target=self._run, daemon=True, name=f"look at {look.group}")
        self.thread.start()

    def _run(self) -> None:
        try:
            self._found = self.look.run()
        except Exception as error:  # noqa: BLE001 - whatever it is, the other looks have something to say
            what = f"could not be looked at: {type(error).__name__}: {error}"
            self._found = [warning(self.look.group, what, "this is a fault of doctor: tell its makers")]

    def outcome(self) -> Sequence[Finding]:
        if self._found is None:
            what = f"not looked at to the end within {self.look.limit_s:g} s"
            return [warning(self.look.group, what, "try again; is this machine very busy?")]
        return self._found
