"""Server-sent events as bytes, made once for all browsers. Pure."""

import json
from collections.abc import Mapping
from typing import Literal

from sse_starlette import ServerSentEvent

Kind = Literal["snapshot", "state", "verdict", "end"]


def event(kind: Kind, fields: Mapping[str, object]) -> bytes:
    """One event; the line's text is JSON without NaN, which no browser reads."""
    text = json.dumps(fields, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return ServerSentEvent(text, event=kind, sep="\n").encode()
