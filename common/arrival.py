"""A message that has arrived, here or in a capture; mcap need not be installed. Pure."""

from dataclasses import dataclass
from typing import Literal, NamedTuple


class Arrival(NamedTuple):
    """One message: its key, its bytes, and when it arrived here (Unix epoch).

    A tuple, because tens of thousands are made per second.
    """

    key: str
    payload: bytes
    arrived_ns: int


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
