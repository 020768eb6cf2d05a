"""What of a lot of arrivals is read: a belief is cumulative, so of each observer only the newest count. Pure.

A service that keeps up reads all that comes. One that has fallen behind, or is flooded, reads what still counts, and is
up to date again with the next lot.
"""

from collections.abc import Sequence
from typing import Protocol, TypeVar

NEWEST = 2
"""So many of each key: should the last be a straggler or a copy, the one before it may be the newest."""


CALM = 64
"""A lot of so many is no sign of being behind."""


class _Keyed(Protocol):
    @property
    def key(self) -> str:
        """Whose it is."""


A = TypeVar("A", bound=_Keyed)


def newest(arrivals: Sequence[A], calm: int = CALM) -> list[A]:
    """The last NEWEST of each key, in the order in which they came; all, when there are no more than `calm`."""
    if len(arrivals) <= max(calm, NEWEST):
        return list(arrivals)
    counts: dict[str, int] = {}
    kept = []
    for arrival in reversed(arrivals):
        count = counts.get(arrival.key, 0)
        if count < NEWEST:
            counts[arrival.key] = count + 1
            kept.append(arrival)
    kept.reverse()
    return kept
