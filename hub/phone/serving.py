"""The server of phones: its files and its WebSocket over HTTPS, in one event loop; the mesh is listened to in a thread.

1. Each phone has one connection; a second one of the same phone ends the first.
2. A phone that does not read, or does not answer the clock, is cut off after SILENT_S. It comes back by itself.
3. Of what the page shows only the newest waits for a phone.
"""

import asyncio
import json
import logging
import ssl
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from http import HTTPStatus
from socket import socket
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, ConnectionClosedError
from websockets.http11 import Request, Response
from websockets.protocol import State

from hub.phone.pages import SOCKET_PATH, Answer
from hub.phone.phone_messages import MESSAGE_LIMIT, BadPhoneMessage, CameraState, LessonRequest
from hub.phone.phone_session import PhoneClock, PhoneSession
from hub.phone.register import RefusedError
from hub.phone.register_file import RegisterFile

log = logging.getLogger("labanmesh.hub")
QUIET = logging.Logger("labanmesh.hub.sockets", logging.CRITICAL)
"""What strangers send that is no HTTP is not worth a line each."""
FIRST_S = 10.0
"""How long a connection may take to say who it is."""
PING_EVERY_S = 1.0
SILENT_S = 5.0
REVOKED_EVERY_S = 0.5
CONNECTIONS_LIMIT = 64
"""At once; a page loads its files over six, one after the other."""
BROKEN, REFUSED, REPLACED = 1008, 4000, 4001
"""Codes of a close: a message broke a rule; not admitted (scan a new code); another connection of this phone came."""
WRITE_LIMIT = 16 * 1024
"""Bytes that may wait for a phone that does not read; an answer has 500."""


@dataclass(slots=True, eq=False)
class _Live:
    """A connection of an admitted phone; words: what its page shows next, `wake` when that is new."""

    connection: ServerConnection
    session: PhoneSession
    wake: asyncio.Event = field(default_factory=asyncio.Event)
    words: Mapping[str, object] | None = None
    heard_s: float = 0.0


@dataclass(slots=True)
class PhoneServer:
    """scene: its name. publish: takes a line of tracks for an observer. answer: to GET of a path, with the host.

    words_of: what the page of an observer shows now. ask: does what a phone asks of the lesson; returns why that cannot
    be, one line, or "".
    """

    scene: str
    phones: RegisterFile
    publish: Callable[[str, bytes], None]
    answer: Callable[[str, str], Answer]
    words_of: Callable[[str], Mapping[str, object]] = lambda observer: {}
    ask: Callable[[LessonRequest], str] = lambda request: "nothing can be taught from here"
    now_ns: Callable[[], int] = time.time_ns
    live: dict[str, _Live] = field(default_factory=dict)
    open_connections: int = 0

    async def run(self, port: socket, context: ssl.SSLContext | None, ended: asyncio.Event) -> None:
        """Serve at the listening socket until `ended`."""
        async with serve(
            self._phone, sock=port, ssl=context, process_request=self._request, open_timeout=FIRST_S, close_timeout=1.0,
            ping_interval=None, server_header=None, logger=QUIET, compression=None, max_size=MESSAGE_LIMIT, max_queue=4,
            write_limit=WRITE_LIMIT, ssl_handshake_timeout=None if context is None else FIRST_S,
        ):  # fmt: skip
            watching = asyncio.create_task(self._watch_revoked())
            await ended.wait()
            watching.cancel()

    def show(self) -> None:
        """Something about the scene is new; to be called in the event loop."""
        for observer, live in self.live.items():
            words = self.words_of(observer)
            if words != live.words:
                live.words = words
                live.wake.set()

    def _request(self, connection: ServerConnection, request: Request) -> Response | None:
        """A file, or None for the WebSocket, which only our own page and programs may open."""
        host, origin = request.headers.get("host", ""), request.headers.get("origin")
        if request.path != SOCKET_PATH:
            return _response(self.answer(request.path, host))
        if origin is not None and urlsplit(origin).netloc != host:
            return _response(Answer(403, b"not from another page\n"))
        if self.open_connections >= CONNECTIONS_LIMIT:
            return _response(Answer(503, b"too many phones\n", {"retry-after": "5"}))
        return None

    async def _phone(self, connection: ServerConnection) -> None:
        self.open_connections += 1
        session, live = PhoneSession(self.phones, self.scene, self.now_ns), None
        address = str((connection.remote_address or ("",))[0])
        try:
            async with asyncio.timeout(FIRST_S):
                await self._take(connection, session, await connection.recv())
            live = self._enter(connection, session)
            await self._converse(live)
        except RefusedError as error:
            log.warning("a phone at %s is refused: %s", address, error)
            await _end(connection, REFUSED, str(error))
        except BadPhoneMessage as error:
            log.warning("%s is cut off: %s", _name(session, address), error)
            await _end(connection, BROKEN, str(error))
        except (ConnectionClosed, TimeoutError):
            pass
        finally:
            self.open_connections -= 1
            for observer in [name for name, each in self.live.items() if each is live]:
                del self.live[observer]
                log.info("%s: the phone is gone", observer)

    def _enter(self, connection: ServerConnection, session: PhoneSession) -> _Live:
        """Take in the connection of an admitted phone, in place of the one that its observer had."""
        assert session.phone is not None  # noqa: S101 - the first message admits, or ends the connection
        if connection.state is not State.OPEN:
            # The page gave it up while it waited here, and may have made the next one already.
            raise ConnectionClosedError(None, None)
        observer = session.phone.observer
        before = self.live.get(observer)
        live = self.live[observer] = _Live(connection, session, heard_s=time.monotonic())
        if before is not None:
            same = before.session.phone is not None and before.session.phone.hash == session.phone.hash
            code = REPLACED if same else REFUSED
            text = "this phone's page was opened again" if same else "another phone took the place of this one"
            asyncio.get_running_loop().create_task(_end(before.connection, code, text))
        log.info("%s: the phone %s is here", observer, session.phone.name or "(no name)")
        self.show()
        return live

    async def _converse(self, live: _Live) -> None:
        tasks = [asyncio.create_task(self._ask(live)), asyncio.create_task(self._tell(live))]
        try:
            async for text in live.connection:
                live.heard_s = time.monotonic()
                await self._take(live.connection, live.session, text)
        finally:
            for task in tasks:
                task.cancel()

    async def _take(self, connection: ServerConnection, session: PhoneSession, text: str | bytes) -> None:
        camera = session.camera
        outcome = session.receive(text)
        if outcome.line is not None and session.phone is not None:
            self.publish(session.phone.observer, outcome.line)
        for answer in outcome.answers:
            await _send(connection, answer)
        if outcome.lesson is not None:
            complaint = self.ask(outcome.lesson)
            if complaint or outcome.lesson.ask != "look":
                await _send(connection, {"complaint": complaint})
        if session.camera is not camera and session.phone is not None:
            _log_camera(session.phone.observer, camera, session.camera)

    async def _ask(self, live: _Live) -> None:
        """Ask for the clock each second, and cut off a phone that no longer answers."""
        with suppress(ConnectionClosed):
            while time.monotonic() - live.heard_s < SILENT_S:
                await asyncio.sleep(PING_EVERY_S)
                pong = asyncio.ensure_future(await live.connection.ping())
                pong.add_done_callback(partial(_note_line, live.session.clock))
                await _send(live.connection, live.session.question())
        live.connection.transport.abort()

    async def _tell(self, live: _Live) -> None:
        with suppress(ConnectionClosed):
            while True:
                await live.wake.wait()
                live.wake.clear()
                await _send(live.connection, {"words": live.words})

    async def _watch_revoked(self) -> None:
        while True:
            await asyncio.sleep(REVOKED_EVERY_S)
            for live in list(self.live.values()):
                if live.session.phone is not None and not self.phones.admits(live.session.phone):
                    await _end(live.connection, REFUSED, "this phone was revoked: scan a new code")


async def serve_files(port: socket, answer: Callable[[str, str], Answer], ended: asyncio.Event) -> None:
    """Answer plain HTTP at the listening socket until `ended`; answer: to GET of a path, with the host."""

    def request(connection: ServerConnection, asked: Request) -> Response:
        return _response(answer(asked.path, asked.headers.get("host", "")))

    async def nothing(connection: ServerConnection) -> None:
        """Never called: every request gets an answer."""

    async with serve(nothing, sock=port, process_request=request, open_timeout=FIRST_S, logger=QUIET):
        await ended.wait()


async def _send(connection: ServerConnection, message: Mapping[str, object]) -> None:
    """Send a message; a phone that does not read for SILENT_S is cut off."""
    try:
        async with asyncio.timeout(SILENT_S):
            await connection.send(json.dumps(message, separators=(",", ":"), allow_nan=False))
    except TimeoutError:
        connection.transport.abort()
        raise


async def _end(connection: ServerConnection, code: int, text: str) -> None:
    """Close with one line; a browser takes at most 123 bytes of it, so it is sent before, too."""
    with suppress(ConnectionClosed, TimeoutError):
        await _send(connection, {"ended": text})
    with suppress(TimeoutError):
        async with asyncio.timeout(SILENT_S):
            await connection.close(code, text.encode()[:120].decode(errors="ignore"))
    # One that floods does not read the close, and what it sends is no longer read.
    connection.transport.abort()


def _response(answer: Answer) -> Response:
    headers = Headers([*answer.headers.items(), ("content-length", str(len(answer.body))), ("connection", "close")])
    return Response(answer.status, HTTPStatus(answer.status).phrase, headers, answer.body)


def _note_line(clock: PhoneClock, pong: "asyncio.Future[float]") -> None:
    if not pong.cancelled() and pong.exception() is None:
        clock.note_line(pong.result())


def _name(session: PhoneSession, address: str) -> str:
    return f"{session.phone.observer}: the phone" if session.phone else f"a phone at {address}"


def _log_camera(observer: str, before: CameraState | None, now: CameraState | None) -> None:
    if now is not None and (before is None or before.state != now.state):
        reason = f": {now.reason}" if now.reason else ""
        level = logging.WARNING if now.state == "failed" else logging.INFO
        log.log(level, "%s: the camera is %s%s", observer, now.state, reason)
