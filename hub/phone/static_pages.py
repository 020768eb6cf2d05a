"""What the server of phones answers to requests for files: the pages, the pose model, the authority's certificate.

1. None of it says anything about anybody, so everybody who reaches the server gets it; what matters goes over the
   WebSocket, for which a code or a secret is needed.
2. Only our own scripts run, and nothing is loaded from or sent to anywhere else (Content-Security-Policy).
"""

import gzip
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files

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
