"""Zenoh's settings for one process, and its error messages in one line. Pure: from the [mesh] section to a dict.

1. Listening addresses and multicast are always set, because Zenoh's defaults are every interface, and on.
2. On one machine all processes are peers: they connect to the fusion process, and gossip connects them to each other.
   Over a router all are clients, because links between peers would bypass its access rules.
3. A process retries its connection for ever, so that the order of starting does not matter. Only the client of a router
   gives up, because Zenoh opens no client session without its router.
4. With credentials both sides show a certificate of the scene's own authority, and the router's must name its host.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from common.config import MeshConfig

MeshRole = Literal["fusion", "standby", "observer", "hub", "router"]
LOOPBACK = "tcp/127.0.0.1:0"
RETRY = {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 2}
"""Fast retry: a router or peer that comes back is found in 0.1 s instead of Zenoh's 2 s."""
LEASE_MS = 2000
"""Peers give up the link of a process that is silent for this long (stopped, cable pulled)."""
MAX_MESSAGE_BYTES = 1 << 20
"""Zenoh drops a longer message while it receives its fragments. Its own limit of 1 GiB lets one put fill a router."""
NEVER_BLOCKING: dict[str, Any] = {
    "id": "never blocking",
    "flows": ["ingress"],
    "messages": ["put", "delete", "query"],
    # No wildcard covers a part that begins with @.
    "key_exprs": ["**", "**/@picture", "**/@teach"],
    "overwrite": {"congestion_control": "drop"},
}
"""For a router, whatever the sender wants: else it waits 5 s for a receiver that is stopped, and all others with it."""
AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE = "ca.pem", "certificate.pem", "key.pem"
"""Files in the folder of credentials."""
ROLE_URI = "labanmesh:"
"""A certificate names its holder's roles as alternative names, `labanmesh:observer:cam1`, for people and for doctor.

Its rights are not in the certificate but in the router's access rules.
"""
ADMITTED = "@/*/router"
"""A router answers this query about itself; with access rules, only to certificates that are in them."""
TLS = "transport/link/tls"


def settings(mesh: "MeshConfig", role: MeshRole, listen: Sequence[str] | None, timeout_s: float) -> dict[str, Any]:
    """Path -> value for a process with `role`; a client looks for its router for `timeout_s`.

    With `listen` the process listens and the others connect to it.
    """
    common = {
        "scouting/multicast/enabled": False,
        "scouting/delay": 0,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
        # For messages of kilobytes it saves nothing, a killed process leaves its segments behind, and where mlock is
        # forbidden no session opens.
        "transport/shared_memory/enabled": False,
        # Tells where a session listens that asked for any free port; readable on the mesh, never writable.
        "adminspace/enabled": True,
        **(tls_settings(mesh.credentials) if mesh.credentials else {}),
    }
    meeting_point = listen is not None or role == "router" or (role == "fusion" and mesh.mode != "router")
    if meeting_point:
        mode = "router" if role == "router" else "peer"
        relaying = {"qos/network": [NEVER_BLOCKING]} if role == "router" else {}
        endpoints = {"listen/endpoints": list(listen or [mesh.endpoint]), "connect/endpoints": []}
        return {**common, **relaying, **endpoints, "mode": mode}
    connect = {"connect/endpoints": [mesh.endpoint], "connect/retry": RETRY}
    if mesh.mode == "router":
        retrying = {"connect/timeout_ms": round(timeout_s * 1000), "connect/exit_on_failure": True}
        return {**common, **connect, **retrying, "mode": "client", "listen/endpoints": []}
    retrying = {"connect/timeout_ms": -1, "connect/exit_on_failure": False}
    return {**common, **connect, **retrying, "mode": "peer", "listen/endpoints": [LOOPBACK]}


def tls_settings(folder: str) -> dict[str, Any]:
    """Mutual TLS with the credentials in `folder`: the same pair whether this process listens or connects."""
    certificate, key = f"{folder}/{CERTIFICATE_FILE}", f"{folder}/{KEY_FILE}"
    return {
        f"{TLS}/root_ca_certificate": f"{folder}/{AUTHORITY_FILE}",
        f"{TLS}/enable_mtls": True,
        f"{TLS}/listen_certificate": certificate,
        f"{TLS}/listen_private_key": key,
        f"{TLS}/connect_certificate": certificate,
        f"{TLS}/connect_private_key": key,
        f"{TLS}/verify_name_on_connect": True,
        # Without it a link outlives the certificates that it was opened with.
        f"{TLS}/close_link_on_expiration": True,
    }


def nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """`{"a/b": 1}` -> `{"a": {"b": 1}}`: the form of Zenoh's configuration files."""
    tree: dict[str, Any] = {}
    for path, value in flat.items():
        *above, last = path.split("/")
        branch = tree
        for part in above:
            branch = branch.setdefault(part, {})
        branch[last] = value
    return tree


def reason(message: str, setting: str) -> str:
    """Zenoh's error message in one line with the way out; `setting` names the endpoint."""
    if "in use" in message:
        return f"{setting}: already in use; stop what listens there or choose another port in the scene file"
    if "Unable to connect" in message:
        return (
            f"{setting}: no router answers there; start it with `labanmesh router --scene SCENE` or correct the address"
        )
    short = " ".join(message.split(" at /")[0].split())[:200]
    return f"{setting}: cannot be used: {short}; an endpoint is PROTOCOL/HOST:PORT, e.g. tcp/127.0.0.1:7447"
