"""Serving the page: the port, the web server in this thread, and beside it one that listens to the mesh."""

import asyncio
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import uvicorn

from common.address import Address
from common.errors import LabanmeshError
from hub.dashboard.access import KEY, Gate
from hub.dashboard.application import Stream, application
from hub.dashboard.audience import Audience
from hub.dashboard.live import first_chronicle, follow
from hub.dashboard.picture import Hall
from hub.dashboard.player import play
from hub.session import Heard

if TYPE_CHECKING:
    from starlette.applications import Starlette

    from common.config import Scene
    from common.link import Link
    from hub.dashboard.tape import Tape

LOOK_S = 0.1
LEAVE_S = 2
"""How long browsers that do not go by themselves are waited for at the end."""


@dataclass(slots=True)
class Run:
    """How long the page is served: until `stop` is set or `for_s` seconds are over.

    alive: called after each piece of work. heard: called with all that is heard, in the listening thread.
    """

    stop: threading.Event
    for_s: float | None = None
    alive: Callable[[], None] = lambda: None
    heard: Callable[[Heard], None] = lambda heard: None
    ended: threading.Event = field(default_factory=threading.Event)


def bound(address: Address) -> socket.socket:
    """The port, taken before anything else begins; raises LabanmeshError, one line, when it cannot be had."""
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    try:
        return socket.create_server((address.host, address.port), family=family)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise LabanmeshError(
            f"{KEY} = {str(address)!r}: {reason}; end what is there, or choose another port with --listen HOST:PORT"
        ) from None


def serve_scene(port: socket.socket, gate: Gate, hall: Hall, scene: "Scene", link: "Link", run: Run) -> None:
    """Show the live `scene`; returns when `run` is over."""

    async def main() -> None:
        audience = Audience(hall, first_chronicle(scene, 0), asyncio.get_running_loop())
        audience.told = run.alive
        failed: list[BaseException] = []

        def listen() -> None:
            try:
                follow(scene, link, audience, lambda: not run.ended.is_set(), run.heard)
            except BaseException as error:  # noqa: BLE001 - handed on to the main thread below
                failed.append(error)
                run.stop.set()

        thread = threading.Thread(target=listen, name="mesh")
        thread.start()
        try:
            app = application(gate, lambda head: audience.stream(), lambda: audience.is_full)
            await _serve(app, port, run, audience.close)
        finally:
            run.ended.set()
            await asyncio.to_thread(thread.join)
        if failed:
            raise failed[0]

    asyncio.run(main())


def serve_tape(port: socket.socket, gate: Gate, hall: Hall, tape: "Tape", run: Run) -> None:
    """Show a capture; returns when `run` is over."""
    stream: Stream = lambda head: play(tape, hall, head)  # noqa: E731 - named for its type
    app = application(gate, stream, lambda: False)
    asyncio.run(_serve(app, port, run, lambda: None))


async def _serve(app: "Starlette", port: socket.socket, run: Run, close: Callable[[], None]) -> None:
    settings = uvicorn.Config(
        app, log_config=None, log_level="error", access_log=False, lifespan="off", ws="none", http="h11",
        server_header=False, timeout_graceful_shutdown=LEAVE_S,
    )  # fmt: skip
    server = uvicorn.Server(settings)

    async def end() -> None:
        loop = asyncio.get_running_loop()
        end_s = None if run.for_s is None else loop.time() + run.for_s
        while not (server.should_exit or run.stop.is_set() or (end_s is not None and loop.time() >= end_s)):
            await asyncio.sleep(LOOK_S)
        server.should_exit = True
        close()

    ending = asyncio.create_task(end())
    await server.serve(sockets=[port])
    await ending
