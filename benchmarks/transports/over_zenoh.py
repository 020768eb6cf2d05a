"""Bare Zenoh: peers with our settings, and Zenoh's own bounded channel instead of our inbox."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from benchmarks.bare_zenoh import BarePeer, bare_peer
from benchmarks.transports.kinds import BATCH, EACH_POSTERIOR, JUDGEMENT, FusionEnd, Put, Take, Transport, posterior_key


@asynccontextmanager
async def fusion(_: str) -> AsyncIterator[FusionEnd]:
    """Listens on a free port: the others connect to it."""
    with bare_peer() as bare:
        yield FusionEnd(_take(bare, EACH_POSTERIOR), _put(bare, JUDGEMENT), bare.locator)


@asynccontextmanager
async def publisher(meeting_point: str, name: str) -> AsyncIterator[Put]:
    """A peer that connects to the fusion process."""
    with bare_peer(meeting_point) as bare:
        yield _put(bare, posterior_key(name))


@asynccontextmanager
async def listener(meeting_point: str) -> AsyncIterator[Take]:
    """A peer that connects to the fusion process."""
    with bare_peer(meeting_point) as bare:
        yield _take(bare, JUDGEMENT)


def _put(bare: BarePeer, key: str) -> Put:
    publisher = bare.publisher(key)

    async def put(payload: bytes) -> None:
        publisher.put(payload)

    return put


def _take(bare: BarePeer, key: str) -> Take:
    fifo = bare.fifo(key)

    async def take() -> list[bytes]:
        batch = [fifo.recv().payload.to_bytes()]
        while len(batch) < BATCH and (sample := fifo.try_recv()) is not None:
            batch.append(sample.payload.to_bytes())
        return batch

    return take


TRANSPORT = Transport(fusion, publisher, listener)
