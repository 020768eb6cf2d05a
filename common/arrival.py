"""A message that has arrived. Pure."""

from typing import NamedTuple


class Arrival(NamedTuple):
    """One message: its key, its bytes, and when it arrived here (Unix epoch).

    A tuple, because tens of thousands are made per second.
    """

    key: str
    payload: bytes
    arrived_ns: int
