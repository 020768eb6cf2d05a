"""The transports under comparison, the functions that each provides, and what this machine lacks for one."""

import importlib
import importlib.util
import os
import shutil
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass

Put = Callable[[bytes], Awaitable[None]]
"""Hands bytes to the transport, at once or as soon as it accepts them."""
Take = Callable[[], Awaitable[list[bytes]]]
"""Waits for a message and returns it with those that have arrived, oldest first, at most BATCH of them."""
BATCH = 256

EACH_POSTERIOR = "laban/bench/observer/*/posterior"
JUDGEMENT = "laban/bench/judgement"


def posterior_key(name: str) -> str:
    """The key of an observer's posteriors; the same in all transports."""
    return EACH_POSTERIOR.replace("*", name)


@dataclass(frozen=True, slots=True)
class FusionEnd:
    """The fusion side: take posteriors, put judgements; meeting_point: where the others connect."""

    take: Take
    put: Put
    meeting_point: str


@dataclass(frozen=True, slots=True)
class Transport:
    """The three roles, each given where to connect: for fusion the broker's address, if there is one."""

    fusion: Callable[[str], AbstractAsyncContextManager[FusionEnd]]
    publisher: Callable[[str, str], AbstractAsyncContextManager[Put]]
    listener: Callable[[str], AbstractAsyncContextManager[Take]]


# Debian installs brokers outside the PATH of ordinary users.
PROGRAM_PATH = f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin"
LIBRARIES = "pip install 'labanmesh[transports]'"


@dataclass(frozen=True, slots=True)
class TransportKind:
    """One transport. module: its file here; library: what that imports; broker: its program."""

    name: str
    module: str
    library: str
    quality: str
    broker: str = ""

    def load(self) -> Transport:
        """Import its functions and its library, and no other's."""
        loaded: Transport = importlib.import_module(f"benchmarks.transports.{self.module}").TRANSPORT
        return loaded

    @property
    def lacks(self) -> str:
        """One line that names what is missing here and how to get it; empty when nothing is."""
        if importlib.util.find_spec(self.library) is None:
            return f"{self.name} is left out: Python finds no {self.library}; {LIBRARIES}"
        if self.broker and program(self.broker) is None:
            return f"{self.name} is left out: {self.broker} is not installed; apt-get install {self.broker}"
        return ""


KINDS: dict[str, TransportKind] = {
    "ours": TransportKind("ours", "over_link", "zenoh", "common.link and its inbox: reliable, drops when it is full"),
    "zenoh": TransportKind("Zenoh", "over_zenoh", "zenoh", "bare, FIFO channel: reliable, drops when it is full"),
    "mqtt": TransportKind("MQTT", "over_mqtt", "paho", "mosquitto and paho-mqtt, QoS 0, TCP_NODELAY", "mosquitto"),
    "nats": TransportKind("NATS", "over_nats", "nats", "nats-server and nats-py, core: at most once", "nats-server"),
    "zeromq": TransportKind("ZeroMQ", "over_zeromq", "zmq", "pyzmq, PUB/SUB: drops past 1,000 waiting messages a peer"),
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
