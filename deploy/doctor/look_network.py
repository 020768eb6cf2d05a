"""Looks at the place where the processes meet: name, port, time to reach it. Never longer than REACH_S."""

import os
import queue
import socket
import threading
import time
from pathlib import Path

from common.config import MeshConfig
from deploy.doctor.network import EVERY_INTERFACE, NO_TCP, Network, Reached, meeting

REACH_S = 1.5
"""A name server and a connection in one house take milliseconds; who takes longer is as good as away."""


def look_at_network(mesh: MeshConfig) -> Network:
    """All but what Zenoh itself says."""
    place = meeting(mesh.endpoint)
    if not place.host:
        return _socket_file(mesh)
    host = _here(place.host)
    local, unusable = _may_listen(place.host, place.port, place.protocol)
    if place.protocol in NO_TCP:
        addresses, fault = resolve(host)
        return Network(mesh, Reached(addresses, fault=fault) if fault else None, local, unusable)
    return Network(mesh, reach(host, place.port), local, unusable)


def reach(host: str, port: int, limit_s: float = REACH_S) -> Reached:
    """One TCP connection to host:port, closed at once."""
    addresses, fault = resolve(host, limit_s)
    if fault:
        return Reached(fault=fault)
    began_s = time.monotonic()
    try:
        with socket.create_connection((addresses[0], port), timeout=limit_s):
            return Reached(addresses, time.monotonic() - began_s)
    except ConnectionRefusedError:
        return Reached(addresses, refused=True, fault="nobody listens there")
    except TimeoutError:
        return Reached(addresses, fault=f"no answer within {limit_s:g} s")
    except OSError as error:
        return Reached(addresses, fault=(error.strerror or str(error)).lower())


def resolve(host: str, limit_s: float = REACH_S) -> tuple[tuple[str, ...], str]:
    """The addresses that a name means, or why there are none; the system's resolver may take minutes, this does not."""
    answers: queue.SimpleQueue[tuple[tuple[str, ...], str]] = queue.SimpleQueue()

    def ask() -> None:
        try:
            found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
            answers.put((tuple(dict.fromkeys(str(each[4][0]) for each in found)), ""))
        except (OSError, UnicodeError):
            answers.put(((), f"the name {host} is not known"))

    threading.Thread(target=ask, daemon=True, name="resolve").start()
    try:
        return answers.get(timeout=limit_s)
    except queue.Empty:
        return (), f"the name server did not answer for {host} within {limit_s:g} s"


def _here(host: str) -> str:
    """Where to reach who listens on `host`: every interface is listened on, not connected to."""
    if host in EVERY_INTERFACE:
        return "::1" if host == "::" else "127.0.0.1"
    return host


def _may_listen(host: str, port: int, protocol: str) -> tuple[bool, str]:
    """Whether `host` is this machine, and why a process of this user could not listen on the port if it were free."""
    addresses, fault = resolve(host.replace("*", "0.0.0.0"))  # noqa: S104 - tried for a moment, never listened on
    if fault:
        return False, ""
    family = socket.AF_INET6 if ":" in addresses[0] else socket.AF_INET
    kind = socket.SOCK_DGRAM if protocol in ("udp", "quic") else socket.SOCK_STREAM
    try:
        _bind(family, kind, addresses[0], 0)
    except OSError:
        return False, ""
    try:
        _bind(family, kind, addresses[0], port)
    except OSError as error:
        return True, (error.strerror or str(error)).lower()
    return True, ""


def _bind(family: socket.AddressFamily, kind: socket.SocketKind, address: str, port: int) -> None:
    with socket.socket(family, kind) as attempt:
        # As Zenoh does: a port whose last connections are still dying is free.
        attempt.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        attempt.bind((address, port))


def _socket_file(mesh: MeshConfig) -> Network:
    folder = Path(mesh.endpoint.partition("/")[2]).parent
    writable = os.access(folder, os.W_OK)
    return Network(mesh, None, local=True, unusable="" if writable else f"{folder} cannot be written")
