"""Bare Zenoh: peers set as ours are, and Zenoh's own bounded channel instead of our inbox."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from benchmarks.bare_zenoh import Bare, bare_peer
from benchmarks.transports.kinds import EACH_POSTERIOR, JUDGEMENT, LOT, Put, Seat, Take, Transport, posterior


@asynccontextmanager
async def referee(_: str) -> AsyncIterator[Seat]:
    """Listens on a free port: the others connect to it."""
    with bare_peer() as bare:
        yield Seat(_take(bare, EACH_POSTERIOR), _put(bare, JUDGEMENT), bare.locator)


@asynccontextmanager
async def publisher(meeting_point: str, name: str) -> AsyncIterator[Put]:
    """A peer that connects to the referee."""
    with bare_peer(meeting_point) as bare:
        yield _put(bare, posterior(name))


@asynccontextmanager
async def listener(meeting_point: str) -> AsyncIterator[Take]:
    """A peer that connects to the referee."""
    with bare_peer(meeting_point) as bare:
        yield _take(bare, JUDGEMENT)


def _put(bare: Bare, key: str) -> Put:
    voice = bare.publisher(key)

    async def put(payload: bytes) -> None:
        voice.put(payload)

    return put


def _take(bare: Bare, key: str) -> Take:
    fifo = bare.fifo(key)

    async def take() -> list[bytes]:
        lot = [fifo.recv().payload.to_bytes()]
        while len(lot) < LOT and (sample := fifo.try_recv()) is not None:
            lot.append(sample.payload.to_bytes())
        return lot

    return take


TRANSPORT = Transport(referee, publisher, listener)
