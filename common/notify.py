"""Telling whoever supervises this process how it is: systemd by its socket, a container's health check by a file.

1. Where nobody asked, nothing happens: systemd sets NOTIFY_SOCKET, a container sets LABANMESH_HEARTBEAT.
2. It never raises and hardly ever waits: a process does its work whether or not its supervisor listens.
3. `alive` is called where work was done, never from a timer of its own: a process that hangs must fall silent.
"""

import contextlib
import logging
import os
import socket
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

SOCKET = "NOTIFY_SOCKET"
HEARTBEAT = "LABANMESH_HEARTBEAT"
ALIVE_EVERY_S = 0.5
"""Signs of life come with each frame; twice a second is enough for whoever waits for half a minute."""
PATIENCE_S = 1.0
"""How long a word that comes only once, as `ready` does, may wait for room in the supervisor's queue."""

log = logging.getLogger("labanmesh.common")


class Notifier:
    """Speaks systemd's notification protocol, and touches the heartbeat file; a context manager: ready, stopping.

    address: a path, or "@name" for an abstract socket; "": nobody asked. heartbeat: a file, None: nobody asked.
    ticks: seconds, never set back. Safe to use from several threads.
    """

    def __init__(
        self, address: str = "", heartbeat: Path | None = None, ticks: Callable[[], float] = time.monotonic
    ) -> None:
        self._address, self._heartbeat, self._ticks = address, heartbeat, ticks
        self._alive_s = float("-inf")
        self._text = ""

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] | None = None) -> "Notifier":
        """The one that `environment` (default: the process's) asks for."""
        asked = os.environ if environment is None else environment
        heartbeat = asked.get(HEARTBEAT, "")
        return cls(asked.get(SOCKET, ""), Path(heartbeat) if heartbeat else None)

    def ready(self, text: str = "") -> None:
        """The process does its work from now on; what depends on it may start. text: as for `status`."""
        self._send("READY=1" + (f"\nSTATUS={_line(text)}" if text else ""), PATIENCE_S)
        self._touch()

    def status(self, text: str) -> None:
        """One line for people, as `systemctl status` shows it; said when it is another than the last."""
        if text != self._text:
            self._text = text
            self._send(f"STATUS={_line(text)}", PATIENCE_S)

    def alive(self) -> None:
        """A piece of work was done; told at most twice a second. Without it the supervisor starts the process anew."""
        now_s = self._ticks()
        if now_s - self._alive_s >= ALIVE_EVERY_S:
            self._alive_s = now_s
            self._send("WATCHDOG=1", 0.0)
            self._touch()

    def stopping(self) -> None:
        """The process ends in order; silence from now on is no fault."""
        self._send("STOPPING=1", PATIENCE_S)
        if self._heartbeat is not None:
            with contextlib.suppress(OSError):
                self._heartbeat.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        self.ready()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stopping()

    def _send(self, text: str, patience_s: float) -> None:
        if not self._address:
            return
        name = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        try:
            # Opened for each word: nothing is shared between threads, and nothing is kept over months.
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as mouth:
                mouth.settimeout(patience_s)
                mouth.sendto(text.encode(), name)
        except OSError as error:
            log.debug("%s = %s: %s was not heard: %s", SOCKET, self._address, text.partition("\n")[0], error)

    def _touch(self) -> None:
        if self._heartbeat is None:
            return
        try:
            self._heartbeat.touch()
        except OSError as error:
            log.warning("%s = %s: %s; the health check will fail", HEARTBEAT, self._heartbeat, error.strerror)
            self._heartbeat = None


def _line(text: str) -> str:
    return " ".join(text.split())
