"""What a transport must give: a place to meet, a way to put bytes, a way to take what has come; and the keys."""

from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass

Put = Callable[[bytes], Awaitable[None]]
"""Hands bytes to the transport, at once or as soon as it takes them."""
Take = Callable[[], Awaitable[list[bytes]]]
"""Waits until something has come, and returns it with what came with it, oldest first: a lot, at most LOT messages."""
LOT = 256

EACH_POSTERIOR = "laban/bench/observer/*/posterior"
JUDGEMENT = "laban/bench/judgement"


def posterior(name: str) -> str:
    """The key under which `name` says what it believes; the same in all transports."""
    return EACH_POSTERIOR.replace("*", name)


@dataclass(frozen=True, slots=True)
class Seat:
    """The referee's place: take posteriors, put judgements; meeting_point: where the others find him."""

    take: Take
    put: Put
    meeting_point: str


@dataclass(frozen=True, slots=True)
class Transport:
    """The three roles. Each is told where to go: the referee the broker's address, if there is one, or nothing."""

    referee: Callable[[str], AbstractAsyncContextManager[Seat]]
    publisher: Callable[[str, str], AbstractAsyncContextManager[Put]]
    listener: Callable[[str], AbstractAsyncContextManager[Take]]
