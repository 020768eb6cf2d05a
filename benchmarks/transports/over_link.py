"""Zenoh as all our processes use it: common.link, and an inbox that one loop empties."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from benchmarks.transports.kinds import EACH_POSTERIOR, JUDGEMENT, FusionEnd, Put, Take, Transport, posterior_key
from common.config import MeshConfig
from common.inbox import Inbox
from common.link import Link, Publisher

LOOPBACK = "tcp/127.0.0.1:0"
WAIT_S = 1.0


@asynccontextmanager
async def fusion(_: str) -> AsyncIterator[FusionEnd]:
    """Listens on a free port, as the fusion service of a scene on one machine does."""
    with Link.open(MeshConfig(), "fusion", listen=[LOOPBACK]) as link:
        yield FusionEnd(_take(link.inbox(EACH_POSTERIOR)), _put(link.publisher(JUDGEMENT)), link.locator)


@asynccontextmanager
async def publisher(meeting_point: str, name: str) -> AsyncIterator[Put]:
    """An observer's link."""
    with Link.open(MeshConfig(endpoint=meeting_point), "observer") as link:
        yield _put(link.publisher(posterior_key(name)))


@asynccontextmanager
async def listener(meeting_point: str) -> AsyncIterator[Take]:
    """A hub's link."""
    with Link.open(MeshConfig(endpoint=meeting_point), "hub") as link:
        yield _take(link.inbox(JUDGEMENT))


def _put(publisher: Publisher) -> Put:
    async def put(payload: bytes) -> None:
        publisher.put(payload)

    return put


def _take(inbox: Inbox) -> Take:
    async def take() -> list[bytes]:
        while not (arrivals := inbox.take(WAIT_S)):
            pass
        return [arrival.payload for arrival in arrivals]

    return take


TRANSPORT = Transport(fusion, publisher, listener)
