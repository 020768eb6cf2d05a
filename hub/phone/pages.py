"""The answers of the phones' server to GET: its files, and the page with the QR codes.

1. The files are the pages, the pose model and the authority's certificate. None of it says anything about anybody, so
   everybody who reaches the server gets it; what matters goes over the WebSocket, for which a code or a secret is
   needed.
2. Only our own scripts run, and nothing is loaded from or sent to anywhere else (Content-Security-Policy).
3. The page with the QR codes is for the screen of the machine itself: plain HTTP on the loopback interface alone. A
   code is made when the page, or the terminal, first shows it, and again when it was used or is too old. The dashboard
   asks for the same as JSON (hub/dashboard/phone_routes.py).
"""

import gzip
import html
import io
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.resources import files

import segno

from hub.phone.register import CODE_LIFETIME, CODES_PATH, SHOWN_PHONES, ShownPhone
from hub.phone.register_file import RegisterFile

SOCKET_PATH = "/socket"
PAGES = {"/": "phone.html", "/trust": "trust.html"}
OWN_FILES = ("phone.js", "tracking.js", "connection.js", "drawing.js", "placing.js", "teaching.js", "phone.css")
SHARED_FILES = ("elements.js", "words.js", "lesson.js", "lesson.css")
"""A lesson looks as on the dashboard's Teach page, whose files these are."""
MEDIA_TYPES = {
    "html": "text/html; charset=utf-8",
    "css": "text/css",
    "js": "text/javascript",
    "mjs": "text/javascript",
    "wasm": "application/wasm",
    "task": "application/octet-stream",
}
COMPRESSED = ("js", "mjs", "wasm")
HOST_HEADER = re.compile(r"[\w.\-\[\]:]{1,255}\Z")
HEADERS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(self), microphone=(), geolocation=()",
}
KEPT = "private, max-age=31536000, immutable"
"""For the pose model, whose address has the version in it."""


@dataclass(frozen=True, slots=True)
class Answer:
    """One answer of the server."""

    status: int
    body: bytes
    headers: Mapping[str, str] = field(default_factory=dict)


class StaticPages:
    """All files by their path. model: the files of the pose model, below /model/; authority: DER, /authority.crt.

    texts: what takes the place of each <!--name--> in the pages.
    """

    def __init__(self, model: Mapping[str, bytes], authority: bytes, texts: Mapping[str, str]) -> None:
        self._answers = {path: _page(name, texts) for path, name in PAGES.items()}
        owners = {**dict.fromkeys(OWN_FILES, "hub.phone"), **dict.fromkeys(SHARED_FILES, "hub.dashboard")}
        for name, owner in owners.items():
            self._answers[f"/{name}"] = _file(name, _static(name, owner), "no-cache")
        self._answers |= {f"/model/{name}": _file(name, content, KEPT) for name, content in model.items()}
        crt = {
            "content-type": "application/x-x509-ca-cert",
            "content-disposition": 'attachment; filename="labanmesh.crt"',
        }
        self._answers["/authority.crt"] = Answer(200, authority, crt)

    def answer(self, path: str, host: str) -> Answer:
        """The answer to GET `path`; host: as the browser names this server, for the policy."""
        known = self._answers.get(path.partition("?")[0], Answer(404, b"not found\n", {"content-type": "text/plain"}))
        return Answer(known.status, known.body, {**HEADERS, "content-security-policy": policy(host), **known.headers})


def policy(host: str) -> str:
    """The Content-Security-Policy. Some browsers do not count a WebSocket as 'self', so it is named."""
    socket = f" wss://{host}" if HOST_HEADER.match(host) else ""
    return (
        f"default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; connect-src 'self'{socket}; "
        "img-src 'self'; media-src 'self' blob:; form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
    )


def _static(name: str, owner: str = "hub.phone") -> bytes:
    return (files(owner) / "static" / name).read_bytes()


def _page(name: str, texts: Mapping[str, str]) -> Answer:
    text = _static(name).decode()
    for key, value in texts.items():
        text = text.replace(f"<!--{key}-->", value)
    return Answer(200, text.encode(), {"content-type": MEDIA_TYPES["html"], "cache-control": "no-cache"})


def _file(name: str, content: bytes, cache: str) -> Answer:
    kind = name.rpartition(".")[2]
    headers = {"content-type": MEDIA_TYPES[kind], "cache-control": cache}
    if kind in COMPRESSED:
        return Answer(200, gzip.compress(content, 6, mtime=0), {**headers, "content-encoding": "gzip"})
    return Answer(200, content, headers)


OWN_NAMES = ("localhost", "127.0.0.1", "[::1]")
RENEW_SHARE = 0.5
"""A code that is shown has at least this share of its time left."""
STYLE = (
    "body{font-family:sans-serif;max-width:60em;margin:2em auto}"
    "section{display:inline-block;margin:1em 3em 1em 0}svg{width:20em}"
)
PAGE_REFRESH_S = 5


@dataclass(slots=True)
class ShownCodes:
    """The codes of the observers that have no phone. address: of the page that the codes open, without the code."""

    file: RegisterFile
    observers: tuple[str, ...]
    address: str
    _codes: dict[str, str] = field(default_factory=dict)

    def link(self, observer: str) -> str | None:
        """The address with a code for `observer`; None while it has a phone."""
        register = self.file.register
        if register.phone_of(observer) is not None:
            return None
        soon = datetime.now(UTC) + CODE_LIFETIME * RENEW_SHARE
        code = self._codes.get(observer, "")
        if register.open_code(code, soon) is None:
            self._codes[observer] = self.file.new_code(observer, beside=code)
        return f"{self.address}#{self._codes[observer]}"

    def phone(self, observer: str) -> str:
        """What the browser of its phone calls itself; "" without a phone, and for one that says nothing."""
        phone = self.file.register.phone_of(observer)
        return phone.name if phone else ""

    def shown(self, observer: str, is_live: bool) -> ShownPhone:
        """The code for `observer`, or its phone."""
        link = self.link(observer)
        if link is None:
            return ShownPhone(observer=observer, address=self.address, phone=self.phone(observer), live=is_live)
        code = self.file.register.open_code(self._codes[observer], datetime.now(UTC))
        expires = round(code.expires.timestamp() * 1000) if code else 0
        modules = tuple("".join("1" if dark else "0" for dark in row) for row in qr_code(link).matrix)
        return ShownPhone(observer=observer, address=self.address, link=link, modules=modules, expires=expires)


def qr_code(link: str) -> segno.QRCode:
    """The QR code of an address."""
    return segno.make(link, error="m", micro=False)


def terminal_code(link: str) -> str:
    """The QR code as text for a terminal, dark on light."""
    text = io.StringIO()
    qr_code(link).terminal(text, compact=True, border=2)
    return text.getvalue()


def code_page(codes: ShownCodes, live: Callable[[], Mapping[str, object]], path: str, host: str) -> Answer:
    """The answer to a request; host: as the browser names this server, which must be this machine's own name."""
    if host.rpartition(":")[0] not in OWN_NAMES:
        return Answer(421, b"this page is for this machine only\n")
    headers = {**HEADERS, "cache-control": "no-store"}
    if path == CODES_PATH:
        shown = tuple(codes.shown(observer, observer in live()) for observer in codes.observers)
        return Answer(200, SHOWN_PHONES.dump_json(shown), {**headers, "content-type": "application/json"})
    if path != "/":
        return Answer(404, b"not found\n")
    parts = [_section(codes, observer, observer in live()) for observer in codes.observers]
    text = (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><meta http-equiv="refresh" content="{PAGE_REFRESH_S}">'
        f"<title>labanmesh: phones</title><style>{STYLE}</style><h1>A phone as a camera</h1>"
        "<p>Scan the code with the phone's camera. It warns of the certificate once; its page says what to do.</p>"
        + "".join(parts)
    )
    policy = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'"
    headers |= {"content-type": "text/html; charset=utf-8", "content-security-policy": policy}
    return Answer(200, text.encode(), headers)


def _section(codes: ShownCodes, observer: str, is_live: bool) -> str:
    link = codes.link(observer)
    if link is None:
        state = "is here" if is_live else f"is not here now: open {html.escape(codes.address)} on it"
        return f"<section><h2>{observer}</h2><p>The phone {html.escape(codes.phone(observer))} {state}.</p></section>"
    code = qr_code(link).svg_inline(scale=6, border=3, light="#fff", dark="#000")
    return f"<section><h2>{observer}</h2>{code}</section>"
