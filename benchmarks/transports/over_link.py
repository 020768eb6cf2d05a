"""Zenoh as every process of ours uses it: common.link, and the inbox that one loop empties."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from benchmarks.transports.kinds import EACH_POSTERIOR, JUDGEMENT, Put, Seat, Take, Transport, posterior
from common.config import MeshConfig
from common.inbox import Inbox
from common.link import Link, Publisher

LOOPBACK = "tcp/127.0.0.1:0"
PATIENCE_S = 1.0


@asynccontextmanager
async def referee(_: str) -> AsyncIterator[Seat]:
    """Listens on a free port, as the fusion service of a scene on one machine does."""
    with Link.open(MeshConfig(), "fusion", listen=[LOOPBACK]) as link:
        yield Seat(_take(link.inbox(EACH_POSTERIOR)), _put(link.publisher(JUDGEMENT)), link.locator)


@asynccontextmanager
async def publisher(meeting_point: str, name: str) -> AsyncIterator[Put]:
    """An observer's link."""
    with Link.open(MeshConfig(endpoint=meeting_point), "observer") as link:
        yield _put(link.publisher(posterior(name)))


@asynccontextmanager
async def listener(meeting_point: str) -> AsyncIterator[Take]:
    """A hub's link."""
    with Link.open(MeshConfig(endpoint=meeting_point), "hub") as link:
        yield _take(link.inbox(JUDGEMENT))


def _put(voice: Publisher) -> Put:
    async def put(payload: bytes) -> None:
        voice.put(payload)

    return put


def _take(inbox: Inbox) -> Take:
    async def take() -> list[bytes]:
        while not (arrivals := inbox.take(PATIENCE_S)):
            pass
        return [arrival.payload for arrival in arrivals]

    return take


TRANSPORT = Transport(referee, publisher, listener)
