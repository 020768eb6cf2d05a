"""The place where the processes meet, `mesh.endpoint`: name, port, time to reach it, and the process that listens.

In mode machine the fusion process listens there, in mode router a router. No attempt takes longer than CONNECT_S. The
checks at the end are pure.
"""

import os
import queue
import re
import socket
import textwrap
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from common.address import ANY_HOST
from common.config import MeshConfig
from common.errors import reason_of
from deploy.doctor.findings import Finding, error, ok, warning

CONNECT_S = 1.5
"""A name server and a connection in one house take milliseconds; one that takes longer is as good as away."""
EVERY_INTERFACE = (*ANY_HOST, "*")
LOOPBACK_HOST = re.compile(r"(127(\.\d+){3}|::1|localhost)\Z")
SECURE = ("tls", "quic")
NO_TCP = ("udp", "quic", "unixsock-stream")
"""Protocols whose port cannot be tried by a TCP connection."""
ENDPOINT_PARTS = re.compile(r"(?P<protocol>[\w-]+)/(?P<host>\[[^]]*\]|[^:]*):(?P<port>\d+)")
LISTENING = "0A"
"""A socket's state in /proc/net/tcp."""
COMMAND_CHARACTERS = 160
"""Of the command line of another process: two lines of a terminal of 80 columns."""


@dataclass(frozen=True, slots=True)
class EndpointParts:
    """`tcp/host:7447` in pieces; host and port are "" and 0 for a socket in the file system."""

    protocol: str
    host: str
    port: int

    @classmethod
    def of(cls, endpoint: str) -> "EndpointParts":
        """The pieces of an endpoint."""
        match = ENDPOINT_PARTS.match(endpoint)
        if match is None:
            return cls(endpoint.partition("/")[0], "", 0)
        return cls(match["protocol"], match["host"].strip("[]"), int(match["port"]))


@dataclass(frozen=True, slots=True)
class Connection:
    """One attempt at host:port. took_s: to a TCP connection; None where none came about.

    refused: the machine answers and nothing listens. fault: why it failed, in words; "" where it did not.
    """

    took_s: float | None = None
    refused: bool = False
    fault: str = ""


@dataclass(frozen=True, slots=True)
class NetworkFacts:
    """The facts of a meeting point. connection: None where TCP cannot try it (udp, quic, a socket file).

    local: the host is this machine. unusable: why a process here could not listen on it; "" where it could.
    listener: the process of this machine that listens there, in words; "" where that is not known.
    zenoh_s: seconds until a Zenoh process answered there; None where none did. fault: Zenoh's complaint.
    """

    mesh: MeshConfig
    connection: Connection | None
    local: bool
    unusable: str = ""
    listener: str = ""
    zenoh_s: float | None = None
    fault: str = ""


def network_facts(mesh: MeshConfig) -> NetworkFacts:
    """What the system tells of `mesh.endpoint`, within a few seconds; `zenoh_s` and `fault` are left unset."""
    parts = EndpointParts.of(mesh.endpoint)
    if not parts.host:
        folder = Path(mesh.endpoint.partition("/")[2]).parent
        unusable = "" if os.access(folder, os.W_OK) else f"the folder {folder} is not writable"
        return NetworkFacts(mesh, None, local=True, unusable=unusable)
    local, unusable = try_to_listen(parts)
    listener = listener_on(parts.port) if local else ""
    # Every interface is listened on, not connected to.
    host = ANY_HOST.get(parts.host.replace("*", "0.0.0.0"), parts.host)  # noqa: S104 - a name only
    if parts.protocol in NO_TCP:
        _, fault = _resolve(host)
        connection = Connection(fault=fault) if fault else None
        return NetworkFacts(mesh, connection, local, unusable, listener)
    return NetworkFacts(mesh, connect_to(host, parts.port), local, unusable, listener)


def connect_to(host: str, port: int, limit_s: float = CONNECT_S) -> Connection:
    """One TCP connection to host:port, closed at once."""
    addresses, fault = _resolve(host, limit_s)
    if fault:
        return Connection(fault=fault)
    began_s = time.monotonic()
    try:
        with socket.create_connection((addresses[0], port), timeout=limit_s):
            return Connection(time.monotonic() - began_s)
    except ConnectionRefusedError:
        return Connection(refused=True, fault="nothing listens there")
    except TimeoutError:
        return Connection(fault=f"no answer within {limit_s:g} s")
    except OSError as error:
        return Connection(fault=reason_of(error))


def try_to_listen(parts: EndpointParts) -> tuple[bool, str]:
    """Whether the host is this machine, and why a process of this user could not listen on the port now."""
    addresses, fault = _resolve(parts.host.replace("*", "0.0.0.0"))  # noqa: S104 - for a moment, and no connection taken
    if fault:
        return False, ""
    family = socket.AF_INET6 if ":" in addresses[0] else socket.AF_INET
    kind = socket.SOCK_DGRAM if parts.protocol in ("udp", "quic") else socket.SOCK_STREAM
    try:
        _bind(family, kind, addresses[0], 0)
    except OSError:
        return False, ""
    try:
        _bind(family, kind, addresses[0], parts.port)
    except OSError as error:
        return True, reason_of(error)
    return True, ""


def listener_on(port: int) -> str:
    """The process of this machine that listens on a TCP port, `PID 123 (python server.py)`; "" where it is not known.

    Only on Linux; processes of other users are shown to root alone.
    """
    sockets = {f"socket:[{inode}]" for inode in _listening_inodes(port)}
    for process in Path("/proc").glob("[0-9]*") if sockets else ():
        with suppress(OSError):
            if any(os.readlink(entry) in sockets for entry in (process / "fd").iterdir()):  # noqa: PTH115 - no path
                words = (process / "cmdline").read_bytes().decode(errors="replace").split("\0")
                return f"PID {process.name} ({textwrap.shorten(' '.join(words), COMMAND_CHARACTERS)})"
    return ""


def _listening_inodes(port: int) -> Iterator[str]:
    for table in ("tcp", "tcp6"):
        with suppress(OSError):
            for line in Path(f"/proc/net/{table}").read_text(encoding="ascii").splitlines()[1:]:
                _, local, _, state, *_, inode = line.split()[:10]
                if state == LISTENING and int(local.rpartition(":")[2], 16) == port:
                    yield inode


def _resolve(host: str, limit_s: float = CONNECT_S) -> tuple[tuple[str, ...], str]:
    """The addresses of a name, or why there are none, within a time limit: the system's resolver may take minutes."""
    answers: queue.SimpleQueue[tuple[tuple[str, ...], str]] = queue.SimpleQueue()

    def ask() -> None:
        try:
            entries = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
            answers.put((tuple(dict.fromkeys(str(entry[4][0]) for entry in entries)), ""))
        except (OSError, UnicodeError):
            answers.put(((), f"the name {host} is not known"))

    threading.Thread(target=ask, daemon=True, name="resolve").start()
    try:
        return answers.get(timeout=limit_s)
    except queue.Empty:
        return (), f"the name server did not answer for {host} within {limit_s:g} s"


def _bind(family: socket.AddressFamily, kind: socket.SocketKind, address: str, port: int) -> None:
    with socket.socket(family, kind) as attempt:
        # As Zenoh does: a port whose last connections are still closing is free.
        attempt.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        attempt.bind((address, port))


def check_network(facts: NetworkFacts) -> list[Finding]:
    """The findings on a meeting point."""
    open_to = exposure(facts.mesh.endpoint)
    findings = [warning(open_to, "labanmesh secure init SCENE, or use a network that you trust")] if open_to else []
    return [*findings, _reachability(facts)]


def is_free(facts: NetworkFacts) -> bool:
    """Whether nothing listens yet where, on one machine, the fusion process will."""
    silent = facts.connection is None or facts.connection.refused
    return facts.zenoh_s is None and facts.mesh.mode == "machine" and silent and facts.local


def exposure(endpoint: str) -> str:
    """What strangers can do at `endpoint` without certificates; "" if only this machine reaches it."""
    parts = EndpointParts.of(endpoint)
    if parts.protocol in SECURE or not parts.host or LOOPBACK_HOST.match(parts.host):
        return ""
    where = "on every interface of this machine" if parts.host in EVERY_INTERFACE else "in the network"
    may = "look on, speak for any observer, teach movements and make it forget them"
    return f"{endpoint}: open {where} without certificates: whoever reaches it may {may}"


def _reachability(facts: NetworkFacts) -> Finding:
    endpoint, connection = facts.mesh.endpoint, facts.connection
    if facts.zenoh_s is not None:
        peer = "a Zenoh router" if facts.mesh.mode == "router" else "Zenoh"
        took_s = facts.zenoh_s if connection is None or connection.took_s is None else connection.took_s
        return ok(f"{endpoint}: {peer} answers, {took_s * 1000:.1f} ms")
    if connection is not None and connection.took_s is not None:
        return _taken(facts)
    if connection is not None and connection.fault and not connection.refused:
        to_do = "correct mesh.endpoint, or the network: cable, WLAN, firewall, name server"
        return error(f"{endpoint}: {connection.fault}", to_do)
    return _no_router(facts) if facts.mesh.mode == "router" else _free(facts)


def _taken(facts: NetworkFacts) -> Finding:
    endpoint = facts.mesh.endpoint
    if EndpointParts.of(endpoint).protocol in SECURE:
        return ok(f"{endpoint}: can be reached; see security for whether it admits this machine")
    listener = facts.listener or "a program"
    what = f"{endpoint}: taken by {listener} that does not answer as Zenoh does, or hangs"
    return error(what, "stop that program, or choose another port in the scene file")


def _no_router(facts: NetworkFacts) -> Finding:
    machine = "this machine" if facts.local else EndpointParts.of(facts.mesh.endpoint).host or "its machine"
    to_do = f"start it on {machine}: labanmesh router --scene SCENE"
    return error(f"{facts.mesh.endpoint}: no router answers there", to_do)


def _free(facts: NetworkFacts) -> Finding:
    endpoint = facts.mesh.endpoint
    if not facts.local:
        what = f'{endpoint}: not an address of this machine, and in mode "machine" the fusion process listens there'
        return error(what, 'on several machines: mode = "router" under [mesh]; on one: tcp/127.0.0.1:7447')
    if facts.unusable:
        what = f"{endpoint}: this user cannot listen there: {facts.unusable}"
        return error(what, "choose another port in the scene file, above 1023")
    return ok(f"{endpoint}: free; the fusion process will listen there")
