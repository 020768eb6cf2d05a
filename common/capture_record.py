"""What a capture is made of: one thing that was heard on a mesh. Pure; how it is written down is in capture_file.py."""

from dataclasses import dataclass
from typing import Literal

CAME, WENT = b"\xc3", b"\xc2"
"""A token's payload: true and false in MessagePack."""

Kind = Literal["put", "answer", "token"]


@dataclass(frozen=True, slots=True)
class Record:
    """One thing that was heard: under which key, how, its bytes, and when it arrived (ns since 1970).

    `token`: a process came or went, the payload is CAME or WENT. `answer`: somebody was asked for his last word; its
    arrival is that of the answer, it may have been said long before.
    """

    kind: Kind
    key: str
    payload: bytes
    arrived_ns: int
