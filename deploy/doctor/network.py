"""What is to be said of the place where the processes meet: `mesh.endpoint`. Pure.

In mode machine the fusion process listens there, in mode router a router.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from deploy.doctor.finding import Finding, error, ok, warning

if TYPE_CHECKING:
    from common.config import MeshConfig

GROUP: Final = "network"
EVERY_INTERFACE = ("0.0.0.0", "::", "*")  # noqa: S104 - what is warned of
LOOPBACK = re.compile(r"(127(\.\d+){3}|::1|localhost)\Z")
SECURE = ("tls", "quic")
NO_TCP = ("udp", "quic", "unixsock-stream")
"""Protocols whose port cannot be tried by a TCP connection."""
ENDPOINT = re.compile(r"(?P<protocol>[\w-]+)/(?P<host>\[[^]]*\]|[^:]*):(?P<port>\d+)")


@dataclass(frozen=True, slots=True)
class Meeting:
    """A meeting point in pieces; host and port are "" and 0 for a socket in the file system."""

    protocol: str
    host: str
    port: int


@dataclass(frozen=True, slots=True)
class Reached:
    """One attempt at host:port. addresses: what the name means. took_s: to a TCP connection; None where none came.

    refused: the machine is there and nobody listens. fault: why it failed, in words; "" where it did not.
    """

    addresses: tuple[str, ...] = ()
    took_s: float | None = None
    refused: bool = False
    fault: str = ""


@dataclass(frozen=True, slots=True)
class Network:
    """What was seen of a meeting point. reached: None where TCP cannot try it (udp, quic, a socket file).

    local: the host is this machine. unusable: why a process here could not listen on it; "" where it could.
    zenoh: seconds until a Zenoh process answered there; None where none did. fault: what Zenoh said instead.
    """

    mesh: "MeshConfig"
    reached: Reached | None
    local: bool
    unusable: str = ""
    zenoh: float | None = None
    fault: str = ""


def meeting(endpoint: str) -> Meeting:
    """`tcp/host:7447` in pieces."""
    found = ENDPOINT.match(endpoint)
    if found is None:
        return Meeting(endpoint.partition("/")[0], "", 0)
    return Meeting(found["protocol"], found["host"].strip("[]"), int(found["port"]))


def findings(network: Network) -> list[Finding]:
    """All that is to be said of it."""
    return [*_exposure(network.mesh), *_reached(network)]


def is_free(network: Network) -> bool:
    """Whether nobody listens yet where, on one machine, the fusion process will."""
    silent = network.reached is None or network.reached.refused
    return network.zenoh is None and network.mesh.mode == "machine" and silent and network.local


def _exposure(mesh: "MeshConfig") -> Iterator[Finding]:
    place = meeting(mesh.endpoint)
    if place.protocol in SECURE or not place.host or LOOPBACK.match(place.host):
        return
    where = "on every interface of this machine" if place.host in EVERY_INTERFACE else "in the network"
    what = f"{mesh.endpoint}: open {where} without encryption; who is in it may listen and speak for any observer"
    yield warning(GROUP, what, "labanmesh secure init, or keep to a network that you trust")


def _reached(network: Network) -> Iterator[Finding]:
    endpoint, reached = network.mesh.endpoint, network.reached
    if network.zenoh is not None:
        who = "a Zenoh router" if network.mesh.mode == "router" else "Zenoh"
        took_s = network.zenoh if reached is None or reached.took_s is None else reached.took_s
        yield ok(GROUP, f"{endpoint}: {who} answers, {took_s * 1000:.1f} ms")
    elif reached is not None and reached.took_s is not None:
        yield _taken(network)
    elif reached is not None and reached.fault and not reached.refused:
        to_do = "correct mesh.endpoint, or the network: cable, WLAN, firewall, name server"
        yield error(GROUP, f"{endpoint}: {reached.fault}", to_do)
    elif network.mesh.mode == "router":
        yield _no_router(network)
    else:
        yield _free(network)


def _taken(network: Network) -> Finding:
    """Somebody listens, and does not speak Zenoh as we do."""
    endpoint = network.mesh.endpoint
    if meeting(endpoint).protocol in SECURE:
        return ok(GROUP, f"{endpoint}: can be reached; whether it lets us in is a matter of security")
    what = f"{endpoint}: taken by something that does not answer as Zenoh does, or hangs"
    return error(GROUP, what, "stop that program, or choose another port in the scene file")


def _no_router(network: Network) -> Finding:
    place = meeting(network.mesh.endpoint)
    on = "this machine" if network.local else place.host or "its machine"
    start = f"labanmesh router {place.protocol}/0.0.0.0:{place.port}" if place.port else "labanmesh router"
    return error(GROUP, f"{network.mesh.endpoint}: no router answers there", f"start it on {on}: {start}")


def _free(network: Network) -> Finding:
    endpoint = network.mesh.endpoint
    if not network.local:
        what = f'{endpoint}: no address of this machine, and in mode "machine" the fusion process listens there'
        return error(GROUP, what, 'on several machines: mode = "router" under [mesh]; on one: tcp/127.0.0.1:7447')
    if network.unusable:
        what = f"{endpoint}: this user cannot listen there: {network.unusable}"
        return error(GROUP, what, "choose another port in the scene file, above 1023")
    return ok(GROUP, f"{endpoint}: free; the fusion process will listen there")
