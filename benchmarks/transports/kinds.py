"""The transports under comparison, the functions that each provides, and what this machine lacks for one."""

import importlib
import importlib.util
import os
import shutil
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass

Put = Callable[[bytes], Awaitable[None]]
"""Hands bytes to the transport, at once or as soon as it takes them."""
Take = Callable[[], Awaitable[list[bytes]]]
"""Waits until something has come, and returns it with what came with it, oldest first: a lot, at most LOT messages."""
LOT = 256

EACH_POSTERIOR = "laban/bench/observer/*/posterior"
JUDGEMENT = "laban/bench/judgement"


def posterior(name: str) -> str:
    """The key under which `name` says what it believes; the same in all transports."""
    return EACH_POSTERIOR.replace("*", name)


@dataclass(frozen=True, slots=True)
class Seat:
    """The referee's place: take posteriors, put judgements; meeting_point: where the others find him."""

    take: Take
    put: Put
    meeting_point: str


@dataclass(frozen=True, slots=True)
class Transport:
    """The three roles. Each is told where to go: the referee the broker's address, if there is one, or nothing."""

    referee: Callable[[str], AbstractAsyncContextManager[Seat]]
    publisher: Callable[[str, str], AbstractAsyncContextManager[Put]]
    listener: Callable[[str], AbstractAsyncContextManager[Take]]


# Debian keeps brokers where only root looks.
PROGRAM_PATH = f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin"
LIBRARIES = "pip install 'labanmesh[transports]'"


@dataclass(frozen=True, slots=True)
class Kind:
    """One way to carry the same bytes. module: its file here; library: what that imports; broker: its program."""

    name: str
    module: str
    library: str
    quality: str
    broker: str = ""

    def load(self) -> Transport:
        """Its functions; imports its library, and no other's."""
        loaded: Transport = importlib.import_module(f"benchmarks.transports.{self.module}").TRANSPORT
        return loaded

    @property
    def lacks(self) -> str:
        """One line that says what is missing here and how to get it; empty when nothing is."""
        if importlib.util.find_spec(self.library) is None:
            return f"{self.name} is left out: Python finds no {self.library}; {LIBRARIES}"
        if self.broker and program(self.broker) is None:
            return f"{self.name} is left out: {self.broker} is not installed; apt-get install {self.broker}"
        return ""


KINDS: dict[str, Kind] = {
    "ours": Kind("ours", "over_link", "zenoh", "common.link and its inbox: reliable link, dropped when it is full"),
    "zenoh": Kind("Zenoh", "over_zenoh", "zenoh", "bare, FIFO channel: reliable link, dropped when it is full"),
    "mqtt": Kind("MQTT", "over_mqtt", "paho", "mosquitto and paho-mqtt, QoS 0, TCP_NODELAY", "mosquitto"),
    "nats": Kind("NATS", "over_nats", "nats", "nats-server and nats-py, core: at most once", "nats-server"),
    "zeromq": Kind("ZeroMQ", "over_zeromq", "zmq", "pyzmq, PUB/SUB: dropped past 1,000 waiting messages a peer"),
}


def program(name: str) -> str | None:
    """Where a broker's program is."""
    return shutil.which(name, path=PROGRAM_PATH)


def here(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """The names of those that can run on this machine, and for each other the line that says why not."""
    missing = {name: KINDS[name].lacks for name in names}
    return [name for name in names if not missing[name]], [line for line in missing.values() if line]
