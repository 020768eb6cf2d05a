"""What a source's text means, and how an address is shown without its secrets. Pure."""

import re
from typing import Literal

SCHEMES = ("rtsp", "rtsps", "http", "https")

Kind = Literal["index", "device", "url", "unknown scheme", "path"]

_HOST = re.compile(r"(\[[0-9a-fA-F:.]+\]|[\w.-]+)(:\d+)?")


def kind_of(text: str) -> Kind:
    """Which kind of source the text names: "0", "/dev/video0", "rtsp://...", "clip.mp4", "pictures/"."""
    if text.isdecimal():
        return "index"
    if text.startswith(("/dev/video", "/dev/v4l/")):
        return "device"
    scheme, separator, _ = text.partition("://")
    if not separator:
        return "path"
    return "url" if scheme.lower() in SCHEMES else "unknown scheme"


def shown(text: str) -> str:
    """The text as it may be printed: of an address only scheme, host, port and a path that holds no secret.

    User, password and query are left out. Where a badly quoted password could pass for something else (an @ or no
    host where they should not be), and so for any scheme, nothing but the scheme is shown.
    """
    scheme, separator, rest = text.partition("://")
    if not separator:
        return text
    authority, path, query = _split(rest)
    host = authority.rpartition("@")[2]
    if "@" in path or "@" in query or not _HOST.fullmatch(host):
        return f"{scheme}://..."
    # Some cameras want /user=NAME_password=SECRET_channel=1 as the path.
    return f"{scheme}://{host}{'/...' if '=' in path else path}"


def _split(rest: str) -> tuple[str, str, str]:
    """Authority, path, and query with fragment, of an address without its scheme."""
    authority = re.split(r"[/?#]", rest, maxsplit=1)[0]
    path = re.split(r"[?#]", rest[len(authority) :], maxsplit=1)[0]
    return authority, path, rest[len(authority) + len(path) :]
