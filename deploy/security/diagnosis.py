"""Why this machine cannot take part in a secured mesh: what `labanmesh doctor` shows of certificates and access."""

from datetime import datetime
from pathlib import Path

from common.config import MeshConfig
from common.credentials import Finding, not_permitted, own_certificate
from common.errors import LabanmeshError
from common.link import Link, Role
from common.tls import TIMEOUT_S, why_unusable

ROLES: tuple[Role, ...] = ("observer", "fusion", "hub")
"""Who is a router's client."""


def diagnose(
    mesh: MeshConfig, now: datetime, role: Role | None = None, named: str = "", timeout_s: float = TIMEOUT_S
) -> list[Finding]:
    """What keeps this machine from meeting the others at `mesh.endpoint`; empty: nothing does.

    now: with its time zone. role, named: what it shall do there, e.g. "observer", "cam1"; without them whatever its
    certificate is for. Each step on the network waits `timeout_s` at most.
    """
    finding = why_unusable(mesh, now, timeout_s)
    if finding is None and mesh.credentials:
        ours = own_certificate(Path(mesh.credentials))
        if role is not None:
            finding = not_permitted(Path(mesh.credentials), role, named)
        as_what = role or next((each for each in ROLES if ours.is_for(each)), None)
        if finding is None and as_what is not None:
            finding = _turned_away(mesh, as_what, named, timeout_s)
    return [] if finding is None else [finding]


def _turned_away(mesh: MeshConfig, role: Role, named: str, timeout_s: float) -> Finding | None:
    """Whether the router answers us once TLS is agreed."""
    try:
        with Link.open(mesh, role, patience_s=timeout_s, named=named):
            return None
    except LabanmeshError as error:
        what, _, what_to_do = str(error).partition("; ")
        return Finding(what, what_to_do)
