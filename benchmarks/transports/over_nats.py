"""Core NATS with nats-py: asyncio throughout, a callback that enqueues."""

import asyncio
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import islice

import nats
from nats.aio.client import Client
from nats.aio.msg import Msg

from benchmarks.transports.kinds import BATCH, EACH_POSTERIOR, JUDGEMENT, FusionEnd, Put, Take, Transport, posterior_key


@asynccontextmanager
async def fusion(server: str) -> AsyncIterator[FusionEnd]:
    """One client that takes and puts."""
    async with _connected(server) as client:
        yield FusionEnd(await _take(client, EACH_POSTERIOR), _put(client, JUDGEMENT), server)


@asynccontextmanager
async def publisher(server: str, name: str) -> AsyncIterator[Put]:
    """A client that puts."""
    async with _connected(server) as client:
        yield _put(client, posterior_key(name))


@asynccontextmanager
async def listener(server: str) -> AsyncIterator[Take]:
    """A client that takes."""
    async with _connected(server) as client:
        yield await _take(client, JUDGEMENT)


@asynccontextmanager
async def _connected(server: str) -> AsyncIterator[Client]:
    client = await nats.connect(f"nats://{server}")
    try:
        yield client
    finally:
        await client.close()


def _put(client: Client, key: str) -> Put:
    subject = key.replace("/", ".")

    async def put(payload: bytes) -> None:
        await client.publish(subject, payload)

    return put


async def _take(client: Client, key: str) -> Take:
    waiting: deque[bytes] = deque()
    something = asyncio.Event()

    async def enqueue(message: Msg) -> None:
        waiting.append(message.data)
        something.set()

    async def take() -> list[bytes]:
        # nats-py must continue to read even if the queue is full.
        await (asyncio.sleep(0) if waiting else something.wait())
        something.clear()
        batch = list(islice(waiting, BATCH))
        for _ in batch:
            waiting.popleft()
        return batch

    await client.subscribe(key.replace("/", "."), cb=enqueue)
    await client.flush()
    return take


TRANSPORT = Transport(fusion, publisher, listener)
