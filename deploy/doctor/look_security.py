"""Looks at this machine's credentials, and why an endpoint that somebody listens on cannot be used."""

from datetime import UTC, datetime
from pathlib import Path

from common.config import MeshConfig
from common.credentials import check_credentials, own_certificate
from common.errors import BadInput
from common.tls import endpoint_fault
from common.zenoh_settings import MeshRole
from deploy.doctor.network import SECURE, Network, meeting
from deploy.doctor.security import Security

PROBE_S = 1.0


def look_at_security(network: Network) -> Security:
    """network: as it was seen, with what Zenoh said."""
    mesh = network.mesh
    now = datetime.now(UTC)
    fault = check_credentials(Path(mesh.credentials), now) if mesh.credentials else None
    said = str(fault) if fault else _unusable(network, now)
    if not mesh.credentials:
        return Security(mesh, fault=said)
    try:
        ours = own_certificate(Path(mesh.credentials))
    except BadInput:
        return Security(mesh, fault=said)
    return Security(mesh, ours.common_name, ours.roles, ours.expires, said)


def _unusable(network: Network, now: datetime) -> str:
    """Why Zenoh did not answer where somebody listens; nothing for what the network's findings say already."""
    if network.zenoh is not None or network.reached is None or network.reached.took_s is None:
        return ""
    why = endpoint_fault(network.mesh, now, PROBE_S)
    if why is not None:
        return str(why)
    secured = meeting(network.mesh.endpoint).protocol in SECURE
    return network.fault or (f"{network.mesh.endpoint}: no session came about" if secured else "")


def as_whom(mesh: MeshConfig) -> tuple[MeshRole, str]:
    """The role, and the id, under which this machine's certificate lets it listen: best a hub, then fusion.

    ("observer", ID) hears little. Without credentials anybody may be a hub.
    """
    if not mesh.credentials:
        return "hub", ""
    try:
        ours = own_certificate(Path(mesh.credentials))
    except BadInput:
        return "hub", ""
    if ours.is_for("hub"):
        return "hub", ""
    by_kind = dict(role.partition(":")[::2] for role in ours.roles)
    if "fusion" in by_kind:
        return "fusion", by_kind["fusion"]
    return ("observer", by_kind["observer"]) if "observer" in by_kind else ("hub", "")
