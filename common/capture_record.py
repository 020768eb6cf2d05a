"""One message of a capture, for programs that read no capture file: mcap need not be installed."""

from dataclasses import dataclass
from typing import Literal

APPEARED, GONE = b"\xc3", b"\xc2"
"""Payload of a token: true and false in MessagePack."""
CaptureKind = Literal["put", "answer", "token"]


@dataclass(frozen=True, slots=True)
class CaptureRecord:
    """One message of a capture: how it arrived, its key, its bytes, and its arrival time (ns since 1970).

    `token`: a process appeared or has gone; the payload is APPEARED or GONE. `answer`: the answer to a query, which may
    have been published long before it arrived.
    """

    kind: CaptureKind
    key: str
    payload: bytes
    arrived_ns: int
