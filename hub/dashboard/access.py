"""Who may read the page: where it listens, by which name it is called, and the word that a browser must know. Pure.

1. On loopback everybody of this machine may read. Elsewhere only who knows the token.
2. Without a token the page answers only to this machine's own names, or a stranger's page could read it through a name
   of his own that leads here (DNS rebinding).
3. The browser keeps a key made from the token, never the token itself; words are compared in constant time.
"""

import hashlib
import hmac
import ipaddress

from common.address import Address
from common.errors import BadInput

KEY = "hub.dashboard.listen"
TOKEN_LEAST = 16
OWN_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
PURPOSE = b"labanmesh dashboard 1"


def is_loopback(address: Address) -> bool:
    """Whether only this machine can reach it; a name other than localhost may lead anywhere."""
    try:
        return ipaddress.ip_address(address.host).is_loopback
    except ValueError:
        return address.host == "localhost"


def checked_token(text: str, where: str) -> str:
    """The token in a file's `text`; raises BadInput that names `where` it is, never the word."""
    word = text.strip()
    if len(word) < TOKEN_LEAST or len(word.split()) != 1 or not word.isascii() or not word.isprintable():
        raise BadInput(
            f"{where}: a token is one word of at least {TOKEN_LEAST} ASCII characters; "
            f"make one: openssl rand -hex 16 > {where.rpartition(' ')[2]}"
        )
    return word


def must_have_token(address: Address) -> BadInput:
    """The refusal to show the page to others without a token."""
    return BadInput(
        f"{KEY} = {str(address)!r}: others can reach that, and hub.dashboard.token_file is not set; "
        "name a file with a word that browsers must know, or listen on 127.0.0.1"
    )


class Gate:
    """Decides on each request. token: None where everybody of this machine may read."""

    def __init__(self, token: str | None) -> None:
        self._token = token.encode() if token is not None else None
        self.cookie = "" if self._token is None else hmac.new(self._token, PURPOSE, hashlib.sha256).hexdigest()

    @property
    def is_open(self) -> bool:
        """Whether no token is asked for."""
        return self._token is None

    def knows(self, word: str) -> bool:
        """Whether `word` is the token."""
        return self._token is None or hmac.compare_digest(word.strip().encode(), self._token)

    def admits(self, cookie: str, authorization: str) -> bool:
        """Whether a request with that cookie, or that Authorization header (`Bearer TOKEN`), may read."""
        if self._token is None:
            return True
        kind, _, word = authorization.partition(" ")
        return hmac.compare_digest(cookie.encode(), self.cookie.encode()) or (
            kind.lower() == "bearer" and self.knows(word)
        )

    def answers_to(self, host: str) -> bool:
        """Whether a request for this Host header is meant for us (rule 2)."""
        name = host[1 : host.find("]")] if host.startswith("[") else host.rpartition(":")[0] or host
        return self._token is not None or name.lower() in OWN_NAMES
