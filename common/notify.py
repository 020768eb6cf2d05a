"""Notifications to a process's supervisor: to systemd by its socket, to a container's health check by a file.

1. Without a supervisor nothing happens: systemd sets NOTIFY_SOCKET, a container sets LABANMESH_HEARTBEAT.
2. A notification never raises and hardly ever waits: a process works whether or not its supervisor listens.
3. `alive` is called where work was done, and never by a timer: a process that hangs must become silent.
"""

import contextlib
import logging
import os
import socket
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Self

from common.errors import reason_of

SOCKET = "NOTIFY_SOCKET"
HEARTBEAT = "LABANMESH_HEARTBEAT"
ALIVE_EVERY_S = 0.5
"""Work is reported with each frame; twice a second is enough for a timeout of half a minute."""
SEND_TIMEOUT_S = 1.0
"""How long a notification that is sent once, as `ready` is, may wait for room in the supervisor's queue."""

log = logging.getLogger("labanmesh.common")


class Notifier:
    """Sends systemd's notifications and touches the heartbeat file; a context manager: ready, stopping.

    address: a path, or "@name" for an abstract socket; "" for none. heartbeat: a file, None for none. ticks: seconds of
    a monotonic clock. Safe to use from several threads.
    """

    def __init__(
        self, address: str = "", heartbeat: Path | None = None, ticks: Callable[[], float] = time.monotonic
    ) -> None:
        self._address, self._heartbeat, self._ticks = address, heartbeat, ticks
        self._alive_s = float("-inf")
        self._text = ""

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] | None = None) -> "Notifier":
        """The notifier that `environment` (default: the process's) requests."""
        variables = os.environ if environment is None else environment
        heartbeat = variables.get(HEARTBEAT, "")
        return cls(variables.get(SOCKET, ""), Path(heartbeat) if heartbeat else None)

    def ready(self, text: str = "") -> None:
        """Report that the process does its work from now on: dependent services may start. text: as for `status`."""
        self._send("READY=1" + (f"\nSTATUS={_line(text)}" if text else ""), SEND_TIMEOUT_S)
        self._touch()

    def status(self, text: str) -> None:
        """Report one line for people, shown by `systemctl status`, if it has changed."""
        if text != self._text:
            self._text = text
            self._send(f"STATUS={_line(text)}", SEND_TIMEOUT_S)

    def alive(self) -> None:
        """Work was done; sent at most twice a second. Without it the supervisor restarts the process."""
        now_s = self._ticks()
        if now_s - self._alive_s >= ALIVE_EVERY_S:
            self._alive_s = now_s
            self._send("WATCHDOG=1", 0.0)
            self._touch()

    def stopping(self) -> None:
        """Report that the process ends as intended: silence from now on is not a fault."""
        self._send("STOPPING=1", SEND_TIMEOUT_S)
        if self._heartbeat is not None:
            with contextlib.suppress(OSError):
                self._heartbeat.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        self.ready()
        return self

    def __exit__(self, *_: object) -> None:
        self.stopping()

    def _send(self, text: str, timeout_s: float) -> None:
        if not self._address:
            return
        name = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        try:
            # A socket per notification: threads share nothing, and a restarted supervisor needs no special case.
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as connection:
                connection.settimeout(timeout_s)
                connection.sendto(text.encode(), name)
        except OSError as error:
            log.debug("%s = %s: %s was not delivered: %s", SOCKET, self._address, text.partition("\n")[0], error)

    def _touch(self) -> None:
        if self._heartbeat is None:
            return
        try:
            self._heartbeat.touch()
        except OSError as error:
            log.warning(
                "cannot write %s = %s: %s; the health check will fail. Choose a folder that this process can write to",
                *(HEARTBEAT, self._heartbeat, reason_of(error)),
            )
            self._heartbeat = None


def _line(text: str) -> str:
    return " ".join(text.split())
