"""The page's web application: static files, the events, the door; what every answer carries so that browsers behave.

1. Nothing is loaded from elsewhere, nothing runs that is not page.js, nobody frames the page (Content-Security-Policy).
2. A browser without the key gets the door, a program without it 401; a wrong word costs a second.
"""

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from importlib.resources import files
from typing import TYPE_CHECKING
from urllib.parse import parse_qs

from sse_starlette import EventSourceResponse
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route

from hub.dashboard.access import Gate
from hub.dashboard.player import FASTEST, Playhead

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

COOKIE = "labanmesh_dashboard"
COOKIE_S = 30 * 24 * 3600
PING_S = 10
"""So often a quiet line says that it is there; the page takes three times that for a broken one."""
WRONG_WORD_S = 1.0
FORM_LIMIT = 2048
HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-cache",
}
KINDS = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
DOOR_FILES = frozenset({"/style.css", "/icon.svg"})
"""What the door itself needs."""
Stream = Callable[[Playhead], AsyncIterator[bytes]]


class Guard:
    """Wraps the application: who may not read gets no further, and all answers carry HEADERS."""

    def __init__(self, app: "ASGIApp", gate: Gate) -> None:
        self._app, self._gate = app, gate

    async def __call__(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        """One request."""

        async def send_guarded(message: "Message") -> None:
            if message["type"] == "http.response.start":
                ours = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                theirs = [pair for pair in message["headers"] if pair[0].lower().decode("latin-1") not in HEADERS]
                message = {**message, "headers": [*theirs, *ours]}
            await send(message)

        if scope["type"] != "http":
            return
        answer = self._refusal(Request(scope))
        await (answer or self._app)(scope, receive, send_guarded)

    def _refusal(self, request: Request) -> Response | None:
        if not self._gate.answers_to(request.headers.get("host", "")):
            words = "This page is for this machine only: open http://127.0.0.1 and its port (docs/guide/dashboard.md)."
            return PlainTextResponse(words, 421)
        path = request.url.path
        if path in DOOR_FILES or path == "/enter":
            return None
        cookie, authorization = request.cookies.get(COOKIE, ""), request.headers.get("authorization", "")
        if self._gate.admits(cookie, authorization):
            return None
        if path == "/":
            return HTMLResponse(door(), 401)
        return PlainTextResponse("The token is missing or wrong.", 401, {"www-authenticate": "Bearer"})


def application(gate: Gate, stream: Stream, is_full: Callable[[], bool]) -> Starlette:
    """The application; `stream` gives what one browser is sent, `is_full` whether there are too many."""

    async def events(request: Request) -> Response:
        if is_full():
            return PlainTextResponse("Too many browsers look on.", 503, {"retry-after": "5"})
        query = request.query_params
        head = Playhead(_number(query.get("at"), 0.0, math.inf), _number(query.get("speed"), 1.0, FASTEST))
        return EventSourceResponse(stream(head), ping=PING_S, sep="\n")

    async def enter(request: Request) -> Response:
        body = b""
        async for piece in request.stream():
            body += piece
            if len(body) > FORM_LIMIT:
                return PlainTextResponse("Too long.", 413)
        word = parse_qs(body.decode("latin-1")).get("token", [""])[0]
        if not gate.knows(word):
            await asyncio.sleep(WRONG_WORD_S)
            return HTMLResponse(door("That is not the token."), 401)
        answer = RedirectResponse("./", 303)
        answer.set_cookie(COOKIE, gate.cookie, COOKIE_S, httponly=True, samesite="strict")
        return answer

    pages = [_page(path, name) for path, name in STATIC.items()]
    routes = [*pages, Route("/events", events), Route("/enter", enter, methods=["POST"])]
    return Starlette(routes=routes, middleware=[Middleware(Guard, gate)])


STATIC = {"/": "page.html", "/style.css": "style.css", "/page.js": "page.js", "/icon.svg": "icon.svg"}


def door(complaint: str = "") -> str:
    """The page that asks for the token."""
    return _static("door.html").decode().replace("<!--complaint-->", complaint)


def _page(path: str, name: str) -> Route:
    content, kind = _static(name), KINDS[name.rpartition(".")[2]]

    async def answer(request: Request) -> Response:
        return Response(content, media_type=kind)

    return Route(path, answer)


def _static(name: str) -> bytes:
    return (files("hub.dashboard") / "static" / name).read_bytes()


def _number(text: str | None, default: float, most: float) -> float:
    """A number from a query: not below 0; what is none is the default."""
    try:
        value = default if text is None else float(text)
    except ValueError:
        return default
    return min(most, max(0.0, value)) if math.isfinite(value) else default
