"""The transports under comparison behind one interface, and what this machine lacks for one.

Every process of a run imports this module, so each function imports its library when it is called, and no other's.
"""

import importlib.util
import os
import shutil
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager, ExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from nats.aio.msg import Msg
    from paho.mqtt.client import Client as MqttClient
    from paho.mqtt.client import MQTTMessage

Role = Literal["fusion", "publisher", "listener"]
Put = Callable[[bytes], Awaitable[None]]
"""Hands bytes to the transport, at once or as soon as it accepts them."""
Take = Callable[[], Awaitable[list[bytes]]]
"""Waits for a message and returns it with those that have arrived, oldest first, at most BATCH of them."""
BATCH = 256

EACH_POSTERIOR = "laban/bench/observer/*/posterior"
JUDGEMENT = "laban/bench/judgement"
LOOPBACK = "tcp/127.0.0.1:0"
WAIT_S = 1.0
# Debian installs brokers outside the PATH of ordinary users.
PROGRAM_PATH = f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin"
LIBRARIES = "pip install 'labanmesh[transports]'"


def posterior_key(name: str) -> str:
    """The key of an observer's posteriors; the same in all transports."""
    return EACH_POSTERIOR.replace("*", name)


@dataclass(frozen=True, slots=True)
class Client:
    """An open transport. put, take: for one key. meeting_point: where others connect, once fusion takes and puts."""

    put: Callable[[str], Put]
    take: Callable[[str], Awaitable[Take]]
    meeting_point: Callable[[], str]


Connect = Callable[[Role, str], AbstractAsyncContextManager[Client]]
"""Opens a transport for a role at a meeting point: for fusion the broker's address, "" without a broker."""


@asynccontextmanager
async def over_link(role: Role, place: str) -> AsyncIterator[Client]:
    """Zenoh as all our processes use it: common.link, and an inbox that one loop empties."""
    from common.config import MeshConfig
    from common.link import Link

    async def take(key: str) -> Take:
        inbox = link.inbox(key)

        async def batch() -> list[bytes]:
            while not (arrivals := inbox.take(WAIT_S)):
                pass
            return [arrival.payload for arrival in arrivals]

        return batch

    if role == "fusion":
        opened = Link.open(MeshConfig(), "fusion", listen=[LOOPBACK])
    else:
        opened = Link.open(MeshConfig(endpoint=place), "observer" if role == "publisher" else "hub")
    with opened as link:
        yield Client(lambda key: _direct(link.publisher(key).put), take, lambda: link.locator)


@asynccontextmanager
async def over_zenoh(role: Role, place: str) -> AsyncIterator[Client]:
    """Bare Zenoh: peers with our settings, and Zenoh's own bounded channel instead of our inbox."""
    from benchmarks.bare_zenoh import bare_peer

    async def take(key: str) -> Take:
        fifo = bare.fifo(key)

        async def batch() -> list[bytes]:
            payloads = [fifo.recv().payload.to_bytes()]
            while len(payloads) < BATCH and (sample := fifo.try_recv()) is not None:
                payloads.append(sample.payload.to_bytes())
            return payloads

        return batch

    with bare_peer(place or None) as bare:
        yield Client(lambda key: _direct(bare.publisher(key).put), take, lambda: bare.locator)


def _direct(write: Callable[[bytes], object]) -> Put:
    async def put(payload: bytes) -> None:
        write(payload)

    return put


@asynccontextmanager
async def over_mqtt(role: Role, broker: str) -> AsyncIterator[Client]:
    """MQTT at QoS 0 with paho, a client for each key: its network thread takes messages, direct writes put them."""

    def put(topic: str) -> Put:
        client = _mqtt_client(broker, stack)

        async def publish(payload: bytes) -> None:
            client.publish(topic, payload, qos=0)
            while client.want_write():
                # The socket is full: wait until it is not.
                client.loop(0.1)

        return publish

    async def take(key: str) -> Take:
        client = _mqtt_client(broker, stack)
        queue: SimpleQueue[bytes] = SimpleQueue()

        def enqueue(client: "MqttClient", userdata: object, message: "MQTTMessage") -> None:
            queue.put(bytes(message.payload))

        async def batch() -> list[bytes]:
            payloads = [queue.get()]
            with suppress(Empty):
                while len(payloads) < BATCH:
                    payloads.append(queue.get_nowait())
            return payloads

        client.on_message = enqueue
        client.subscribe(key.replace("*", "+"), qos=0)
        client.loop_start()
        stack.callback(client.loop_stop)
        return batch

    with ExitStack() as stack:
        yield Client(put, take, lambda: broker)


def _mqtt_client(broker: str, stack: ExitStack) -> "MqttClient":
    """A connected client, which the stack disconnects."""
    import socket

    from paho.mqtt.client import Client as MqttClient
    from paho.mqtt.enums import CallbackAPIVersion

    def set_no_delay(client: MqttClient, userdata: Any, sock: Any) -> None:  # noqa: ANN401 - paho's own signature
        # Nagle's algorithm would delay a small message until the last one is acknowledged.
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    host, _, port = broker.partition(":")
    client = MqttClient(CallbackAPIVersion.VERSION2)
    client.on_socket_open = set_no_delay
    client.connect(host, int(port))
    while not client.is_connected():
        client.loop(0.1)
    stack.callback(client.disconnect)
    return client


@asynccontextmanager
async def over_nats(role: Role, server: str) -> AsyncIterator[Client]:
    """Core NATS with nats-py: asyncio throughout, a callback that enqueues."""
    import asyncio

    import nats

    def put(key: str) -> Put:
        subject = key.replace("/", ".")

        async def publish(payload: bytes) -> None:
            await client.publish(subject, payload)

        return publish

    async def take(key: str) -> Take:
        waiting: deque[bytes] = deque()
        something = asyncio.Event()

        async def enqueue(message: "Msg") -> None:
            waiting.append(message.data)
            something.set()

        async def batch() -> list[bytes]:
            # nats-py must continue to read even if the queue is full.
            await (asyncio.sleep(0) if waiting else something.wait())
            something.clear()
            payloads = list(islice(waiting, BATCH))
            for _ in payloads:
                waiting.popleft()
            return payloads

        await client.subscribe(key.replace("/", "."), cb=enqueue)
        await client.flush()
        return batch

    client = await nats.connect(f"nats://{server}")
    try:
        yield Client(put, take, lambda: server)
    finally:
        await client.close()


@asynccontextmanager
async def over_zeromq(role: Role, place: str) -> AsyncIterator[Client]:
    """PUB/SUB with pyzmq, without a broker: fusion binds a SUB and a PUB, the others connect; the key is a frame."""
    import zmq

    endpoints: list[str] = []

    def opened(kind: int, number: int) -> Any:  # noqa: ANN401 - pyzmq may be missing here
        """A socket, bound to a free port in fusion, else connected to the endpoint of that number."""
        one = stack.enter_context(stack.enter_context(zmq.Context()).socket(kind))
        one.setsockopt(zmq.LINGER, 0)
        if place:
            one.connect(place.split()[number])
        else:
            one.bind("tcp://127.0.0.1:*")
            endpoints.append(one.getsockopt_string(zmq.LAST_ENDPOINT))
        return one

    def put(key: str) -> Put:
        pub, topic = opened(zmq.PUB, 0), key.encode()
        return _direct(lambda payload: pub.send_multipart((topic, payload)))

    async def take(key: str) -> Take:
        sub = opened(zmq.SUB, 1)
        sub.setsockopt_string(zmq.SUBSCRIBE, key.partition("*")[0])

        async def batch() -> list[bytes]:
            payloads = [sub.recv_multipart()[1]]
            with suppress(zmq.Again):
                while len(payloads) < BATCH:
                    payloads.append(sub.recv_multipart(zmq.NOBLOCK)[1])
            return payloads

        return batch

    with ExitStack() as stack:
        yield Client(put, take, lambda: " ".join(endpoints))


@dataclass(frozen=True, slots=True)
class TransportKind:
    """One transport. library: what `connect` imports; quality: what it guarantees; broker: its program."""

    name: str
    connect: Connect
    library: str
    quality: str
    broker: str = ""

    @property
    def lacks(self) -> str:
        """One line that names what is missing here and how to get it; empty when nothing is."""
        if importlib.util.find_spec(self.library) is None:
            return f"{self.name} is left out: Python finds no {self.library}; {LIBRARIES}"
        if self.broker and program(self.broker) is None:
            return f"{self.name} is left out: {self.broker} is not installed; apt-get install {self.broker}"
        return ""


KINDS: dict[str, TransportKind] = {
    "ours": TransportKind("ours", over_link, "zenoh", "common.link and its inbox: reliable, drops when it is full"),
    "zenoh": TransportKind("Zenoh", over_zenoh, "zenoh", "bare, FIFO channel: reliable, drops when it is full"),
    "mqtt": TransportKind("MQTT", over_mqtt, "paho", "mosquitto and paho-mqtt, QoS 0, TCP_NODELAY", "mosquitto"),
    "nats": TransportKind("NATS", over_nats, "nats", "nats-server and nats-py, core: at most once", "nats-server"),
    "zeromq": TransportKind("ZeroMQ", over_zeromq, "zmq", "pyzmq, PUB/SUB: drops past 1,000 waiting messages a peer"),
}


def program(name: str) -> str | None:
    """The path of a broker's program."""
    return shutil.which(name, path=PROGRAM_PATH)


@dataclass(frozen=True, slots=True)
class AvailableKinds:
    """The names of the transports that can run on this machine, and for each other one the reason in one line."""

    names: list[str]
    left_out: list[str]


def available(names: Sequence[str]) -> AvailableKinds:
    """Which of `names` can run on this machine."""
    missing = {name: KINDS[name].lacks for name in names}
    return AvailableKinds([name for name in names if not missing[name]], [line for line in missing.values() if line])
