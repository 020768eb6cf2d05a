"""Which transports there are, what each promises of a message, and what this machine lacks for one."""

import importlib
import importlib.util
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.transports.posts import Transport

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
