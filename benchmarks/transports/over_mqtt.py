"""MQTT at QoS 0 with paho: its network thread takes messages, direct writes put them."""

import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import Any

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

from benchmarks.transports.kinds import BATCH, EACH_POSTERIOR, JUDGEMENT, FusionEnd, Put, Take, Transport, posterior_key


@asynccontextmanager
async def fusion(broker: str) -> AsyncIterator[FusionEnd]:
    """Two clients: the thread of one takes, the other puts."""
    with _subscribed(broker, EACH_POSTERIOR.replace("*", "+")) as take, _connected_put(broker, JUDGEMENT) as put:
        yield FusionEnd(take, put, broker)


@asynccontextmanager
async def publisher(broker: str, name: str) -> AsyncIterator[Put]:
    """A client without a thread, which writes to the socket at once."""
    with _connected_put(broker, posterior_key(name)) as put:
        yield put


@asynccontextmanager
async def listener(broker: str) -> AsyncIterator[Take]:
    """A client with paho's thread."""
    with _subscribed(broker, JUDGEMENT) as take:
        yield take


@contextmanager
def _connected(broker: str) -> Iterator[Client]:
    host, _, port = broker.partition(":")
    client = Client(CallbackAPIVersion.VERSION2)
    # Nagle's algorithm would delay a small message until the last one is acknowledged.
    client.on_socket_open = _no_delay
    client.connect(host, int(port))
    while not client.is_connected():
        client.loop(0.1)
    try:
        yield client
    finally:
        client.disconnect()


def _no_delay(client: Client, userdata: Any, sock: Any) -> None:  # noqa: ANN401 - paho's own signature
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


@contextmanager
def _connected_put(broker: str, topic: str) -> Iterator[Put]:
    with _connected(broker) as client:

        async def put(payload: bytes) -> None:
            client.publish(topic, payload, qos=0)
            while client.want_write():
                # The socket is full: wait until it is not.
                client.loop(0.1)

        yield put


@contextmanager
def _subscribed(broker: str, topic: str) -> Iterator[Take]:
    queue: SimpleQueue[bytes] = SimpleQueue()

    def enqueue(client: Client, userdata: object, message: MQTTMessage) -> None:
        queue.put(bytes(message.payload))

    async def take() -> list[bytes]:
        batch = [queue.get()]
        with suppress(Empty):
            while len(batch) < BATCH:
                batch.append(queue.get_nowait())
        return batch

    with _connected(broker) as client:
        client.on_message = enqueue
        client.subscribe(topic, qos=0)
        client.loop_start()
        try:
            yield take
        finally:
            client.loop_stop()


TRANSPORT = Transport(fusion, publisher, listener)
