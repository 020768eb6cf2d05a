"""A mesh inside this process: Zenoh peers that meet at one link on 127.0.0.1, at a port that the system chooses."""

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from common.config import MeshConfig
from common.link import Link, MeshRole
from common.zenoh_settings import LOOPBACK

SERVICE_END_S = 40.0
"""A service ends within milliseconds of its stop event; a machine that is busy with other tests needs longer."""


@contextmanager
def running(serve: Callable[..., object], *arguments: object) -> Iterator[tuple[threading.Event, threading.Thread]]:
    """Run `serve(*arguments, stop)` in a thread; yields its stop event and the thread. Its failure is the test's."""
    stop, faults = threading.Event(), list[Exception]()

    def body() -> None:
        try:
            serve(*arguments, stop)
        except Exception as error:  # noqa: BLE001 - raised below, in the test's thread
            faults.append(error)

    thread = threading.Thread(target=body, daemon=True)
    thread.start()
    try:
        yield stop, thread
    finally:
        stop.set()
        thread.join(SERVICE_END_S)
    if faults:
        raise faults[0]
    if thread.is_alive():
        raise TimeoutError(f"{serve} did not end within {SERVICE_END_S:g} s of its stop event")


class Mesh:
    """Peers that meet at the link `meeting`; all close together. config: as the other processes need it."""

    def __init__(self, config: MeshConfig | None = None) -> None:
        self._opened = ExitStack()
        given = MeshConfig(endpoint=LOOPBACK) if config is None else config
        self.meeting = self._opened.enter_context(Link.open(given, "fusion"))
        self.config = given.at(self.meeting.locator)

    def peer(self, role: MeshRole = "hub") -> Link:
        """One more process of the mesh, as far as the others can tell; closed with the mesh."""
        return self._opened.enter_context(Link.open(self.config, role))

    def run(self, serve: Callable[..., Any], *arguments: object) -> tuple[threading.Event, threading.Thread]:
        """Run a service until the mesh closes, or until the stop event that is returned is set."""
        return self._opened.enter_context(running(serve, *arguments))

    def close(self) -> None:
        """End all services, the last one first, and all peers."""
        self._opened.close()
