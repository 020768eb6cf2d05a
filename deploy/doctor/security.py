"""This machine's credentials, and why an endpoint that is in use cannot be used with them. The checks are pure."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from common.config import MeshConfig, Scene
from common.credentials import Certificate, check_credentials, own_certificate
from common.errors import BadInput
from common.tls import endpoint_fault
from common.zenoh_settings import MeshRole
from deploy.doctor.findings import Finding, error, from_fault, ok, warning
from deploy.doctor.network import SECURE, EndpointParts, NetworkFacts

PROBE_S = 1.0
SOON_DAYS = 30
SECURITY_WAY_OUT = "docs/guide/security.md has the steps; labanmesh secure list shows all certificates"


@dataclass(frozen=True, slots=True)
class SecurityFacts:
    """certificate: this machine's; None where there is none.

    fault: why the credentials, or the endpoint with them, cannot be used: one line with the way out; "" where they can.
    """

    mesh: MeshConfig
    certificate: Certificate | None = None
    fault: str = ""


def security_facts(network: NetworkFacts) -> SecurityFacts:
    """The facts for a meeting point of which it is known already whether Zenoh answers."""
    mesh = network.mesh
    now = datetime.now(UTC)
    credentials_fault = check_credentials(Path(mesh.credentials), now) if mesh.credentials else None
    fault = str(credentials_fault) if credentials_fault else _endpoint_fault(network, now)
    return SecurityFacts(mesh, _certificate(mesh), fault)


def listener_for(scene: Scene) -> tuple[MeshRole, str]:
    """The role and id under which this machine's certificate lets the doctor listen; an observer hears little.

    Hub if the certificate allows it, else fusion. Without credentials any process can be a hub.
    """
    certificate = _certificate(scene.mesh)
    if certificate is None or certificate.is_for("hub", scene=scene.scene):
        return "hub", ""
    ids = dict(role.partition(":")[::2] for role in certificate.roles)
    for role in ("fusion", "observer"):
        if role in ids:
            return role, ids[role].rpartition("/")[2]
    return "hub", ""


def _certificate(mesh: MeshConfig) -> Certificate | None:
    try:
        return own_certificate(Path(mesh.credentials)) if mesh.credentials else None
    except BadInput:
        return None


def _endpoint_fault(network: NetworkFacts, now: datetime) -> str:
    """Why Zenoh does not answer where something listens; "" for faults that the network's findings have already."""
    if network.zenoh_s is not None or network.connection is None or network.connection.took_s is None:
        return ""
    fault = endpoint_fault(network.mesh, now, PROBE_S)
    if fault is not None:
        return str(fault)
    secured = EndpointParts.of(network.mesh.endpoint).protocol in SECURE
    return network.fault or (f"{network.mesh.endpoint}: no session came about" if secured else "")


def check_security(facts: SecurityFacts, now: datetime) -> list[Finding]:
    """The findings on credentials at `now` (with its time zone)."""
    findings = list(_expiry(facts.certificate, now)) if facts.certificate else []
    if facts.fault:
        return [*findings, from_fault("error", facts.fault, SECURITY_WAY_OUT)]
    if not facts.mesh.credentials:
        return [ok("no credentials (mesh.credentials), so no encryption and no access rules")]
    if facts.certificate is None:
        return [error(f"{facts.mesh.credentials}: no certificate could be read", SECURITY_WAY_OUT)]
    return findings


def _expiry(certificate: Certificate, now: datetime) -> Iterator[Finding]:
    if now >= certificate.expires:
        return
    days, name = certificate.days_left(now), certificate.common_name
    roles = f" for {', '.join(certificate.roles)}" if certificate.roles else ""
    what = f"certificate {name}{roles}: valid for {days:.0f} more days, until {certificate.expires:%Y-%m-%d}"
    if days > SOON_DAYS:
        yield ok(what)
    else:
        machine = name.rpartition(".")[0] or name
        yield warning(what, f"labanmesh secure renew SCENE {machine}, and copy the new folder here")
