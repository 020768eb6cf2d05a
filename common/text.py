"""Text that people type and read: values of command-line options, plural forms, suggestions. Pure."""

import re
from collections.abc import Iterable, Mapping, Sequence

from common.errors import BadInput

_CAMERA_ADDRESS = re.compile(
    r"((?:rtsps?|https?):(?:/{1,2}|(?!\d))|[A-Za-z][\w+.-]*://)?(.*)", re.DOTALL | re.IGNORECASE
)
_KNOWN_SCHEME = re.compile(r"(rtsps?|https?|ftps?|sftp|rtmps?|rtp|srt|udp|mms):", re.IGNORECASE)
"""Of cameras, and of what people take for a camera's address; any other word may be a user."""
_HOST = re.compile(r"(\[[0-9a-fA-F:.]+\]|[\w.-]+)(:\d+)?")
_USER = re.compile(r"[^/]*:.*@|[\w.-]+:\d+[/?#]", re.DOTALL)
"""How an address without its scheme begins: with a user and a password, or with a host and a port."""


def plural(count: int, singular: str, irregular: str = "") -> str:
    """The count with its noun: `1 recording`, `2 recordings`; `irregular` is a plural that does not end in s."""
    return f"{count} {singular if count == 1 else irregular or singular + 's'}"


def periods_line(periods: Mapping[str, float]) -> str:
    """Which movements go on while they are repeated; periods: seconds of one repetition, by label."""
    repeated = ", ".join(f"{label} every {period_s:.1f} s" for label, period_s in periods.items())
    return f"repeated: {repeated}; any other movement is a new one each time"


def nearest(word: str, known: Iterable[str]) -> str:
    """A suggestion for an unknown word: the nearest known one, or all of them if none is near."""
    from difflib import get_close_matches

    names = list(known)
    near = get_close_matches(word, names, 1)
    return f"did you mean {near[0]}?" if near else f"known: {', '.join(names)}"


def split_list(option: str, text: str) -> tuple[str, ...]:
    """The parts of a list separated by commas: `a, b` -> (`a`, `b`); empty text has no parts.

    Raises BadInput for an empty part.
    """
    parts = tuple(part.strip() for part in text.split(",")) if text else ()
    if not all(parts):
        raise BadInput(f"{option} {text!r}: a name is missing between commas; write NAME,NAME")
    return parts


def named_numbers(option: str, texts: Sequence[str]) -> dict[str, float]:
    """Each `NAME=NUMBER` as an entry of a dictionary; raises BadInput for any other text."""
    numbers = {}
    for text in texts:
        name, equals, number = text.partition("=")
        try:
            numbers[name.strip()] = float(number)
        except ValueError:
            equals = ""
        if not equals or not name.strip():
            raise BadInput(f"{option} {text!r}: NAME=NUMBER is expected")
    return numbers


def one_of(option: str, value: str, known: Sequence[str]) -> str:
    """`value` if it is in `known`; raises BadInput that lists the known values otherwise."""
    if value not in known:
        raise BadInput(f"{option} {value!r}: unknown; known: {', '.join(known)}")
    return value


def without_secrets(text: str, *, show_path: bool = False) -> str:
    """A source as it may be printed: of an address only scheme, host and port, as its rest may hold a secret.

    Also of an address that lacks its scheme. show_path: the path too, unless a password can be in it. Where a badly
    quoted password could hide in what is left (an @ or a missing host in an unexpected place), only the scheme remains.
    """
    match = _CAMERA_ADDRESS.fullmatch(text)
    scheme, rest = (match[1] or "", match[2]) if match else ("", text)
    if not scheme and not _USER.match(rest):
        return text
    if "@" in rest and not _KNOWN_SCHEME.match(scheme):
        scheme = ""  # it may be a user, and the slashes the begin of a password
    authority = re.split(r"[/?#]", rest, maxsplit=1)[0]
    host, behind = authority.rpartition("@")[2], rest[len(authority) :]
    if "@" in behind or not _HOST.fullmatch(host):
        return f"{scheme}..."
    path = re.split(r"[?#]", behind, maxsplit=1)[0]
    # Some cameras expect /user=NAME_password=SECRET_channel=1 as the path.
    shown = path if show_path and "=" not in path else "/..." if len(behind) > 1 else behind
    return f"{scheme}{host}{shown}" if scheme or host == authority else f"...@{host}{shown}"


def with_whole_examples(text: str | None) -> str:
    """A verb's help in which each example stays one line, which can be copied, however narrow the terminal is."""
    # Slow to import, and needed for help alone.
    from inspect import cleandoc

    paragraphs = cleandoc(text or "").split("\n\n")
    return "\n\n".join(f"\b\n{' '.join(each.split())}" if each.startswith("Example:") else each for each in paragraphs)
