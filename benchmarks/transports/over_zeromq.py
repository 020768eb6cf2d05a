"""ZeroMQ PUB/SUB with pyzmq, no broker: the referee binds both sockets, the others connect; a frame for the key."""

from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import TypeAlias

import zmq

from benchmarks.transports.kinds import EACH_POSTERIOR, JUDGEMENT, LOT, Put, Seat, Take, Transport, posterior

LOOPBACK = "tcp://127.0.0.1:*"
Socket: TypeAlias = "zmq.Socket[bytes]"


@asynccontextmanager
async def referee(_: str) -> AsyncIterator[Seat]:
    """Binds a SUB for posteriors and a PUB for judgements, each on a free port."""
    with _socket(zmq.SUB) as ear, _socket(zmq.PUB) as mouth:
        ear.setsockopt_string(zmq.SUBSCRIBE, EACH_POSTERIOR.partition("*")[0])
        yield Seat(_take(ear), _put(mouth, JUDGEMENT), f"{_bound(ear)} {_bound(mouth)}")


@asynccontextmanager
async def publisher(meeting_point: str, name: str) -> AsyncIterator[Put]:
    """A PUB that connects to the referee's SUB."""
    with _socket(zmq.PUB) as mouth:
        mouth.connect(meeting_point.split()[0])
        yield _put(mouth, posterior(name))


@asynccontextmanager
async def listener(meeting_point: str) -> AsyncIterator[Take]:
    """A SUB that connects to the referee's PUB."""
    with _socket(zmq.SUB) as ear:
        ear.setsockopt_string(zmq.SUBSCRIBE, JUDGEMENT)
        ear.connect(meeting_point.split()[1])
        yield _take(ear)


@contextmanager
def _socket(kind: int) -> Iterator[Socket]:
    with zmq.Context() as context, context.socket(kind) as made:
        made.setsockopt(zmq.LINGER, 0)
        yield made


def _bound(made: Socket) -> str:
    made.bind(LOOPBACK)
    endpoint: str = made.getsockopt_string(zmq.LAST_ENDPOINT)
    return endpoint


def _put(mouth: Socket, key: str) -> Put:
    topic = key.encode()

    async def put(payload: bytes) -> None:
        mouth.send_multipart((topic, payload))

    return put


def _take(ear: Socket) -> Take:
    async def take() -> list[bytes]:
        lot = [ear.recv_multipart()[1]]
        with suppress(zmq.Again):
            while len(lot) < LOT:
                lot.append(ear.recv_multipart(zmq.NOBLOCK)[1])
        return lot

    return take


TRANSPORT = Transport(referee, publisher, listener)
