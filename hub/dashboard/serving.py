"""Serving the page: the port, the web server in this thread, and a thread that listens to the mesh."""

import asyncio
import socket
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import uvicorn
from starlette.applications import Starlette

from common import SECOND_NS
from common.config import Scene
from common.link import Link
from common.messages import VerdictMessage
from hub.dashboard.access import AccessControl
from hub.dashboard.application import Stream, application
from hub.dashboard.connections import accept_connections, protocol_in, table_for_this_process
from hub.dashboard.history import CaptureTimeline, SceneHistory
from hub.dashboard.history_routes import history_routes
from hub.dashboard.page_data import CROWD, PageSetup, state_data, verdict_data
from hub.dashboard.phone_routes import phone_routes
from hub.dashboard.pictures import PictureRelay
from hub.dashboard.streams import LiveStream, event, play
from hub.dashboard.teach_routes import TEACHING_IS_OFF, TeachPage, people_routes
from hub.people_names_file import PeopleNames
from hub.scene_state import SceneState
from hub.session import SceneListener, SceneUpdate, has_right
from hub.teaching.lesson_server import LessonServer

SERVER_CHECK_S = 0.1
SHUTDOWN_S = 2
"""How long the end waits for browsers that do not disconnect."""
NO_TEACH_RIGHT = (
    "This dashboard's certificate has no right to teach. Where the certificates are made: "
    "labanmesh secure add SCENE NAME --hub --teach; then copy the new folder here."
)
CAPTURE = "This page shows a capture. A running scene is taught with: labanmesh dashboard SCENE --teach"
STATE_EVERY_NS = SECOND_NS // 10
CROWD_EVERY_NS = 3 * SECOND_NS // 10
"""The state of many observers is long, and changes faster than anybody reads it."""


@dataclass(slots=True)
class ServingRun:
    """How long a page is served, until `stop` is set, and what is called meanwhile.

    alive: called after each piece of work. record: called with every update, in the listening thread.
    """

    stop: threading.Event
    alive: Callable[[], None] = lambda: None
    record: Callable[[SceneUpdate], None] = lambda update: None


class Follower:
    """Publishes to `stream` what happens in a scene: verdicts at once, the state ten times a second."""

    def __init__(self, setup: PageSetup, first: SceneHistory, stream: LiveStream) -> None:
        self._setup, self._history, self._stream, self._sent_ns = setup, first, stream, 0

    def note(self, update: SceneUpdate, present: Iterable[str]) -> None:
        """Take in an update; present: the observers with a liveliness token."""
        message, now_ns, verdict = update.message, update.state.now_ns, None
        before = self._history.update(update.state, message)
        self._history = history = before.with_presence(present)
        if isinstance(message, VerdictMessage):
            verdict = event("verdict", verdict_data(message, history, self._setup.quorum))
        every_ns = CROWD_EVERY_NS if len(history.state.observers) > CROWD else STATE_EVERY_NS
        if abs(now_ns - self._sent_ns) >= every_ns or before is not history:
            self._sent_ns = now_ns
            self._stream.publish(history, verdict, event("state", state_data(history, self._setup.names())))
        elif verdict is not None:
            self._stream.publish(history, verdict)


def serve_scene(
    port: socket.socket, access: AccessControl, setup: PageSetup, scene: Scene, link: Link, run: ServingRun
) -> None:
    """Show the live `scene`; returns when `run` is over."""

    async def main() -> None:
        people = PeopleNames(scene)
        page = replace(setup, names=lambda: people.names)
        pictures = PictureRelay(scene.keys, setup.pictures, link, has_right(scene, "pictures"))
        first = SceneHistory(SceneState(scene.scene, scene.roster, services=scene.services))
        stream = LiveStream(page, first, run.alive)
        follower = Follower(page, first, stream)
        with _teach_page(access, scene, link, setup.file) as (teach, note_lesson):

            def note(update: SceneUpdate) -> None:
                run.record(update)
                note_lesson(update)
                follower.note(update, listener.tokens)

            def tidy() -> None:
                pictures.end_unwatched()
                listener.check()

            rights = has_right(scene, "history"), has_right(scene, "pictures")
            more = [*history_routes(scene, access.teaches, *rights), *phone_routes(scene, access)]
            more += people_routes(people, access)
            app = application(
                access, lambda head: stream.browser(), lambda: stream.is_full, pictures.newest, teach, more
            )
            with SceneListener(scene, link, note, newest_only=False) as listener:
                await _serve(app, port, run, lambda: _end(stream, teach), tidy)

    asyncio.run(main())


def _end(stream: LiveStream, teach: TeachPage) -> None:
    stream.close()
    teach.end()


@contextmanager
def _teach_page(
    access: AccessControl, scene: Scene, link: Link, file: str = "SCENE"
) -> Iterator[tuple[TeachPage, Callable[[SceneUpdate], None]]]:
    if not access.teaches or not has_right(scene, "teach"):
        yield (
            TeachPage(access, off=NO_TEACH_RIGHT if access.teaches else TEACHING_IS_OFF.replace("SCENE", file)),
            lambda update: None,
        )
        return
    hubs = link.presence(scene.keys.hub_alive("mqtt"))
    lesson_server = LessonServer(scene, link)
    try:
        yield TeachPage(access, lesson_server, scene=scene, hubs=lambda: hubs.alive, file=file), lesson_server.note
    finally:
        lesson_server.close()


def serve_capture(
    port: socket.socket, access: AccessControl, setup: PageSetup, timeline: CaptureTimeline, run: ServingRun
) -> None:
    """Show a capture; returns when `run` is over."""
    closed = asyncio.Event()
    stream: Stream = lambda head: play(timeline, setup, head, closed)  # noqa: E731 - named for its type
    app = application(access, stream, lambda: False, teach=TeachPage(access, off=CAPTURE))
    asyncio.run(_serve(app, port, run, closed.set))


class _PageServer(uvicorn.Server):
    """Leaves signals to `stop_on_signals`: on its own, uvicorn cuts the event streams off and reports an error."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


async def _serve(
    app: Starlette,
    port: socket.socket,
    run: ServingRun,
    close: Callable[[], None],
    tidy: Callable[[], None] = lambda: None,
) -> None:
    browser_connection = protocol_in(table := table_for_this_process())
    settings = uvicorn.Config(
        app, log_config=None, log_level="error", access_log=False, lifespan="off", ws="none", http=browser_connection,
        server_header=False, timeout_graceful_shutdown=SHUTDOWN_S,
    )  # fmt: skip
    settings.load()
    server = _PageServer(settings)

    def connection() -> asyncio.BaseProtocol:
        return browser_connection(config=settings, server_state=server.server_state, app_state={})

    async def end() -> None:
        try:
            while not run.stop.is_set():
                await asyncio.sleep(SERVER_CHECK_S)
                tidy()
        finally:
            accepting.cancel()
            server.should_exit = True
            close()

    accepting = asyncio.create_task(accept_connections(port, table, connection))
    ending = asyncio.create_task(end())
    # Without a socket of its own: connections are accepted above.
    await server.serve(sockets=[])
    await ending
