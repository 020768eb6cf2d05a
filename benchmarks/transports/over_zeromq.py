"""ZeroMQ PUB/SUB with pyzmq, without a broker: fusion binds both sockets, the others connect; the key is a frame."""

from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import TypeAlias

import zmq

from benchmarks.transports.kinds import BATCH, EACH_POSTERIOR, JUDGEMENT, FusionEnd, Put, Take, Transport, posterior_key

LOOPBACK = "tcp://127.0.0.1:*"
Socket: TypeAlias = "zmq.Socket[bytes]"


@asynccontextmanager
async def fusion(_: str) -> AsyncIterator[FusionEnd]:
    """Binds a SUB for posteriors and a PUB for judgements, each on a free port."""
    with _socket(zmq.SUB) as sub, _socket(zmq.PUB) as pub:
        sub.setsockopt_string(zmq.SUBSCRIBE, EACH_POSTERIOR.partition("*")[0])
        yield FusionEnd(_take(sub), _put(pub, JUDGEMENT), f"{_bound(sub)} {_bound(pub)}")


@asynccontextmanager
async def publisher(meeting_point: str, name: str) -> AsyncIterator[Put]:
    """A PUB that connects to the fusion process's SUB."""
    with _socket(zmq.PUB) as pub:
        pub.connect(meeting_point.split()[0])
        yield _put(pub, posterior_key(name))


@asynccontextmanager
async def listener(meeting_point: str) -> AsyncIterator[Take]:
    """A SUB that connects to the fusion process's PUB."""
    with _socket(zmq.SUB) as sub:
        sub.setsockopt_string(zmq.SUBSCRIBE, JUDGEMENT)
        sub.connect(meeting_point.split()[1])
        yield _take(sub)


@contextmanager
def _socket(kind: int) -> Iterator[Socket]:
    with zmq.Context() as context, context.socket(kind) as opened:
        opened.setsockopt(zmq.LINGER, 0)
        yield opened


def _bound(opened: Socket) -> str:
    opened.bind(LOOPBACK)
    endpoint: str = opened.getsockopt_string(zmq.LAST_ENDPOINT)
    return endpoint


def _put(pub: Socket, key: str) -> Put:
    topic = key.encode()

    async def put(payload: bytes) -> None:
        pub.send_multipart((topic, payload))

    return put


def _take(sub: Socket) -> Take:
    async def take() -> list[bytes]:
        batch = [sub.recv_multipart()[1]]
        with suppress(zmq.Again):
            while len(batch) < BATCH:
                batch.append(sub.recv_multipart(zmq.NOBLOCK)[1])
        return batch

    return take


TRANSPORT = Transport(fusion, publisher, listener)
