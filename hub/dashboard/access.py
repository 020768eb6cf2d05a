"""Who may read the dashboard's pages, and who may teach: the token, the headers of every answer, the static files.

1. On loopback every user of this machine may read; elsewhere only browsers and programs that know the token.
2. Without a token the page answers only to this machine's own names; otherwise a foreign page could read it through a
   host name that leads here (DNS rebinding).
3. A browser keeps keys made from the token, never the token itself; secrets are compared in constant time.
4. Nothing is loaded from elsewhere, only our own scripts run, and no page may frame these (Content-Security-Policy).
5. A browser without the key gets the token form, a program 401. A wrong token costs a second in the form, and an
   address with too many of them gets 429 for a minute (guesses.py).
6. No browser may store a live picture, not even for the moment between two of them.
7. To teach needs the token on every request, in a header that no foreign page can send; the cookie only reads.
"""

import asyncio
import hashlib
import hmac
import ipaddress
import logging
import time
from collections.abc import Callable
from importlib.resources import files

from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from common.address import Address
from common.errors import BadInput
from hub.dashboard.guesses import GuessLimit, address_group

log = logging.getLogger("labanmesh.hub")
LISTEN_KEY = "hub.dashboard.listen"
TOKEN_MIN_LENGTH = 16
LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
COOKIE_PURPOSE, TEACH_PURPOSE = b"labanmesh dashboard 1", b"labanmesh teach 1"
COOKIE = "labanmesh_dashboard"
COOKIE_S = 30 * 24 * 3600
WRONG_TOKEN_S = 1.0
DASHBOARD_HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-cache",
}
DASHBOARD_MEDIA_TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
OPEN_SCRIPTS = ("/elements.js", "/words.js", "/figures.js", "/teach.js", "/lesson.js")
OPEN_PATHS = frozenset({"/style.css", "/icon.svg", "/enter", "/teach", "/teach.css", "/lesson.css", *OPEN_SCRIPTS})
"""What the token form needs, and the Teach page, which shows nothing without the token."""
TEACH_PATHS = "/teach/"
"""The requests of the Teach page, which have a check of their own (teach_routes.py)."""
BODY_S = 10.0
"""How long sending a form may take."""
NO_STORE = "no-store"


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
    """Decides on each request. token: None where every user of this machine may read.

    teach_token: of those who may teach; None: nobody may. made_token: a token that was made for this run. ticks:
    monotonic seconds.
    """

    def __init__(
        self,
        token: str | None,
        teach_token: str | None = None,
        made_token: str = "",
        ticks: Callable[[], float] = time.monotonic,
    ) -> None:
        self.made_token = made_token
        self._guesses, self._ticks = GuessLimit(), ticks
        self._token = token.encode() if token is not None else None
        self._teach_token = teach_token.encode() if teach_token is not None else None
        self.cookie = _made_of(self._token, COOKIE_PURPOSE)
        self.teach_key = _made_of(self._teach_token, TEACH_PURPOSE)

    @property
    def teaches(self) -> bool:
        """Whether anybody may teach."""
        return self._teach_token is not None

    def is_token(self, word: str) -> bool:
        """Whether `word` is the token."""
        return self._token is None or hmac.compare_digest(word.strip().encode(), self._token)

    def admits(self, cookie: str, authorization: str) -> bool:
        """Whether a request with this cookie, or this Authorization header (`Bearer TOKEN`), may read."""
        if self._token is None or self.admits_teaching(authorization):
            return True
        return hmac.compare_digest(cookie.encode(), self.cookie.encode()) or (
            _bearer(authorization) != "" and self.is_token(_bearer(authorization))
        )

    def admits_teaching(self, authorization: str) -> bool:
        """Whether a request with this Authorization header, the token or the key made from it, may teach."""
        word = _bearer(authorization).strip().encode()
        if self._teach_token is None or not word:
            return False
        return hmac.compare_digest(word, self._teach_token) or hmac.compare_digest(word, self.teach_key.encode())

    def may_change(self, authorization: str) -> bool:
        """Whether a request that may read may also see the codes by which phones become cameras, and name people."""
        return self._token is None or self.admits_teaching(authorization)

    def wait_s(self, address: str) -> int:
        """Seconds for which tokens from `address` are refused unread, after too many wrong ones; 0: they are read."""
        if self._token is None and self._teach_token is None:
            return 0
        return self._guesses.wait_s(address, self._ticks())

    def record_wrong(self, address: str, word: str) -> None:
        """Count a wrong word of `address`; "" is none."""
        if word:
            self._guesses.wrong(address, word, self._ticks())
            log.warning("a wrong token from %s", address)

    def answers_to(self, host: str) -> bool:
        """Whether a request with this Host header is answered (rule 2)."""
        name = host[1 : host.find("]")] if host.startswith("[") else host.rpartition(":")[0] or host
        return self._token is not None or name.lower() in LOOPBACK_NAMES


def _made_of(token: bytes | None, purpose: bytes) -> str:
    return "" if token is None else hmac.new(token, purpose, hashlib.sha256).hexdigest()


def _bearer(authorization: str) -> str:
    kind, _, word = authorization.partition(" ")
    return word if kind.lower() == "bearer" else ""


class AccessMiddleware:
    """Wraps the application: stops requests that may not read, and adds DASHBOARD_HEADERS to every answer."""

    def __init__(self, app: ASGIApp, access: AccessControl) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                ours = [(name.encode(), value.encode()) for name, value in DASHBOARD_HEADERS.items()]
                stored = (b"cache-control", NO_STORE.encode())
                if stored in message["headers"]:
                    ours = [stored, *(pair for pair in ours if pair[0] != stored[0])]
                theirs = [
                    pair for pair in message["headers"] if pair[0].lower().decode("latin-1") not in DASHBOARD_HEADERS
                ]
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
        if path in OPEN_PATHS or path.startswith(TEACH_PATHS):
            return None
        cookie, authorization = request.cookies.get(COOKIE, ""), request.headers.get("authorization", "")
        address = address_of(request)
        if wait_s := self._access.wait_s(address):
            return too_many_guesses(wait_s)
        if self._access.admits(cookie, authorization):
            return None
        self._access.record_wrong(address, cookie + authorization)
        if path == "/":
            return HTMLResponse(token_form(), 401)
        return PlainTextResponse("The token is missing or wrong.", 401, {"www-authenticate": "Bearer"})


def token_form(fault: str = "") -> str:
    """The page that asks for the token."""
    return static_file("door.html").decode().replace("<!--fault-->", fault)


def address_of(request: Request) -> str:
    """From where a request comes, as guesses are counted."""
    return address_group(request.client.host if request.client else "")


def too_many_guesses(wait_s: int) -> Response:
    """The answer to an address that has guessed too often."""
    text = f"Too many wrong tokens came from your address. Try again in {wait_s} s.\n"
    return PlainTextResponse(text, 429, {"retry-after": str(wait_s)})


async def body_of(request: Request, limit: int) -> bytes:
    """The body of a request, or the first bytes of one that is longer than `limit`; raises TimeoutError."""

    async def read() -> bytes:
        body = b""
        async for piece in request.stream():
            body += piece
            if len(body) > limit:
                break
        return body

    return await asyncio.wait_for(read(), BODY_S)


def static_page(path: str, name: str, content: bytes | None = None) -> Route:
    """A route for a static file, or for `content` made of it."""
    body, media_type = content or static_file(name), DASHBOARD_MEDIA_TYPES[name.rpartition(".")[2]]

    async def answer(request: Request) -> Response:
        return Response(body, media_type=media_type)

    return Route(path, answer)


def static_file(name: str) -> bytes:
    """The content of a file of the pages."""
    return (files("hub.dashboard") / "static" / name).read_bytes()
