"""The page's web application: static files, the event stream, the token form, and who may read them.

1. On loopback every user of this machine may read; elsewhere only browsers and programs that know the token.
2. Without a token the page answers only to this machine's own names; otherwise a foreign page could read it through a
   host name that leads here (DNS rebinding).
3. A browser keeps a key made from the token, never the token itself; secrets are compared in constant time.
4. Nothing is loaded from elsewhere, only page.js runs, and no page may frame this one (Content-Security-Policy).
5. A browser without the key gets the token form, a program 401. A wrong token costs a second in the form, and an
   address with too many of them gets 429 for a minute (guesses.py).
6. No browser may store a live picture, not even for the moment between two of them.
"""

import asyncio
import hashlib
import hmac
import ipaddress
import logging
import math
import time
from collections.abc import AsyncIterator, Callable, Mapping
from importlib.resources import files
from typing import TYPE_CHECKING
from urllib.parse import parse_qs

from sse_starlette import EventSourceResponse
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route

from common.address import Address
from common.errors import BadInput
from hub.dashboard.guesses import GuessLimit, address_group
from hub.dashboard.pictures import PictureAnswer, PictureState
from hub.dashboard.streams import Playhead

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

log = logging.getLogger("labanmesh.hub")
LISTEN_KEY = "hub.dashboard.listen"
TOKEN_MIN_LENGTH = 16
OWN_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
COOKIE_PURPOSE = b"labanmesh dashboard 1"
COOKIE = "labanmesh_dashboard"
COOKIE_S = 30 * 24 * 3600
PING_S = 10
"""How often an idle stream shows that it is alive; the page reconnects after three times this."""
WRONG_TOKEN_S = 1.0
FORM_LIMIT, FORM_S = 2048, 10.0
"""Bytes of a sent form, and how long sending them may take."""
MAX_AT_S = 1e9
MAX_SPEED = 64.0
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
MEDIA_TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
STATIC = {"/": "page.html", "/style.css": "style.css", "/page.js": "page.js", "/icon.svg": "icon.svg"}
OPEN_PATHS = frozenset({"/style.css", "/icon.svg", "/enter"})
"""What the token form itself needs."""
NO_PICTURE: Mapping[PictureState, tuple[int, str]] = {
    "none yet": (204, ""),
    "switched off": (404, "No pictures of this judge: set picture_hz in its section of the scene file.\n"),
    "no right": (403, "This dashboard's certificate has no right to pictures: labanmesh secure add ... --pictures.\n"),
}
"""The answer where there is no picture to show: status and reason."""
NO_STORE = "no-store"
Stream = Callable[[Playhead], AsyncIterator[bytes]]
Newest = Callable[[str], PictureAnswer]
"""The newest live picture of an observer."""


def is_loopback(address: Address) -> bool:
    """Whether only this machine can reach it; any name other than localhost may lead elsewhere."""
    try:
        return ipaddress.ip_address(address.host).is_loopback
    except ValueError:
        return address.host == "localhost"


def checked_token(text: str, where: str) -> str:
    """The token in a file's `text`; raises BadInput that names `where` it is and does not reveal it."""
    token = text.strip()
    if len(token) < TOKEN_MIN_LENGTH or len(token.split()) != 1 or not token.isascii() or not token.isprintable():
        raise BadInput(
            f"{where}: a token is one word of at least {TOKEN_MIN_LENGTH} ASCII characters; "
            f"make one: openssl rand -hex 16 > {where.rpartition(' ')[2]}"
        )
    return token


class AccessControl:
    """Decides on each request. token: None where every user of this machine may read. ticks: monotonic seconds."""

    def __init__(self, token: str | None, ticks: Callable[[], float] = time.monotonic) -> None:
        self._token = token.encode() if token is not None else None
        self._guesses, self._ticks = GuessLimit(), ticks
        self.cookie = "" if self._token is None else hmac.new(self._token, COOKIE_PURPOSE, hashlib.sha256).hexdigest()

    def is_token(self, word: str) -> bool:
        """Whether `word` is the token."""
        return self._token is None or hmac.compare_digest(word.strip().encode(), self._token)

    def admits(self, cookie: str, authorization: str) -> bool:
        """Whether a request with this cookie, or this Authorization header (`Bearer TOKEN`), may read."""
        if self._token is None:
            return True
        kind, _, word = authorization.partition(" ")
        return hmac.compare_digest(cookie.encode(), self.cookie.encode()) or (
            kind.lower() == "bearer" and self.is_token(word)
        )

    def wait_s(self, address: str) -> int:
        """For how many seconds no word of `address` is looked at, because too many were wrong; 0: it is."""
        return 0 if self._token is None else self._guesses.wait_s(address, self._ticks())

    def record_wrong(self, address: str, word: str) -> None:
        """Count a wrong word of `address`; "" is none."""
        if word:
            self._guesses.wrong(address, word, self._ticks())
            log.warning("a wrong token from %s", address)

    def answers_to(self, host: str) -> bool:
        """Whether a request with this Host header is answered (rule 2)."""
        name = host[1 : host.find("]")] if host.startswith("[") else host.rpartition(":")[0] or host
        return self._token is not None or name.lower() in OWN_NAMES


class AccessMiddleware:
    """Wraps the application: stops requests that may not read, and adds HEADERS to every answer."""

    def __init__(self, app: "ASGIApp", access: AccessControl) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        """Handle one request."""

        async def send_with_headers(message: "Message") -> None:
            if message["type"] == "http.response.start":
                ours = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                stored = (b"cache-control", NO_STORE.encode())
                if stored in message["headers"]:
                    ours = [stored, *(pair for pair in ours if pair[0] != stored[0])]
                theirs = [pair for pair in message["headers"] if pair[0].lower().decode("latin-1") not in HEADERS]
                message = {**message, "headers": [*theirs, *ours]}
            await send(message)

        if scope["type"] != "http":
            return
        answer = self._refusal(Request(scope))
        await (answer or self._app)(scope, receive, send_with_headers)

    def _refusal(self, request: Request) -> Response | None:
        if not self._access.answers_to(request.headers.get("host", "")):
            text = "This page is for this machine only: open http://127.0.0.1 and its port (docs/guide/dashboard.md)."
            return PlainTextResponse(text, 421)
        path = request.url.path
        if path in OPEN_PATHS:
            return None
        cookie, authorization = request.cookies.get(COOKIE, ""), request.headers.get("authorization", "")
        address = _address(request)
        if wait_s := self._access.wait_s(address):
            return _too_many_guesses(wait_s)
        if self._access.admits(cookie, authorization):
            return None
        self._access.record_wrong(address, cookie + authorization)
        if path == "/":
            return HTMLResponse(token_form(), 401)
        return PlainTextResponse("The token is missing or wrong.", 401, {"www-authenticate": "Bearer"})


def application(
    access: AccessControl, stream: Stream, is_full: Callable[[], bool], newest_picture: Newest | None = None
) -> Starlette:
    """The application; `stream` yields the events of one browser, `is_full` tells whether there are too many.

    newest_picture: of a live scene; a capture has no pictures.
    """

    async def events(request: Request) -> Response:
        if is_full():
            return PlainTextResponse("Too many browsers are connected. Try again later.", 503, {"retry-after": "5"})
        query = request.query_params
        try:
            head = Playhead(_number(query, "at", 0.0, MAX_AT_S), _number(query, "speed", 1.0, MAX_SPEED))
        except ValueError as error:
            return PlainTextResponse(f"{error}\n", 400)
        return EventSourceResponse(stream(head), ping=PING_S, sep="\n")

    async def enter(request: Request) -> Response:
        address = _address(request)
        if wait_s := access.wait_s(address):
            return _too_many_guesses(wait_s)
        try:
            body = await asyncio.wait_for(_body(request), FORM_S)
        except TimeoutError:
            return PlainTextResponse("Too slow.", 408)
        if len(body) > FORM_LIMIT:
            return PlainTextResponse("Too long.", 413)
        word = parse_qs(body.decode("latin-1")).get("token", [""])[0]
        if not access.is_token(word):
            access.record_wrong(address, word)
            await asyncio.sleep(WRONG_TOKEN_S)
            return HTMLResponse(token_form("That is not the token."), 401)
        answer = RedirectResponse("./", 303)
        answer.set_cookie(COOKIE, access.cookie, COOKIE_S, httponly=True, samesite="strict")
        return answer

    def picture(request: Request) -> Response:
        answer = newest_picture(request.path_params["observer"]) if newest_picture else PictureAnswer("switched off")
        name = str(answer.captured_ns)
        headers = {"cache-control": NO_STORE, "x-picture": name}
        if answer.state != "picture":
            status, reason = NO_PICTURE[answer.state]
            return PlainTextResponse(reason, status, headers)
        if request.query_params.get("after") == name:
            return Response(status_code=204, headers=headers)
        return Response(answer.jpeg, media_type="image/jpeg", headers=headers)

    pages = [_page(path, name) for path, name in STATIC.items()]
    routes = [*pages, Route("/events", events), Route("/enter", enter, methods=["POST"])]
    routes.append(Route("/picture/{observer}", picture))
    return Starlette(routes=routes, middleware=[Middleware(AccessMiddleware, access)])


async def _body(request: Request) -> bytes:
    """The body of a request, or the first bytes of one that is longer than FORM_LIMIT."""
    body = b""
    async for piece in request.stream():
        body += piece
        if len(body) > FORM_LIMIT:
            break
    return body


def _address(request: Request) -> str:
    return address_group(request.client.host if request.client else "")


def _too_many_guesses(wait_s: int) -> Response:
    text = f"Too many wrong tokens came from your address. Try again in {wait_s} s.\n"
    return PlainTextResponse(text, 429, {"retry-after": str(wait_s)})


def token_form(fault: str = "") -> str:
    """The page that asks for the token."""
    return _static("door.html").decode().replace("<!--fault-->", fault)


def _page(path: str, name: str) -> Route:
    content, media_type = _static(name), MEDIA_TYPES[name.rpartition(".")[2]]

    async def answer(request: Request) -> Response:
        return Response(content, media_type=media_type)

    return Route(path, answer)


def _static(name: str) -> bytes:
    return (files("hub.dashboard") / "static" / name).read_bytes()


def _number(query: Mapping[str, str], name: str, default: float, most: float) -> float:
    """The number `name` of a query, 0 to `most`; raises ValueError, one line, for anything else."""
    text = query.get(name)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value <= most:
        raise ValueError(f"{name} = {text[:40]!r}: must be a number from 0 to {most:g}")
    return value
