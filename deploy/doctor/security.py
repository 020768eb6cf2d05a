"""What is to be said of this machine's credentials, and of what came of using them. Pure: the time is passed in."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Final

from deploy.doctor.finding import Finding, error, ok, told, warning

if TYPE_CHECKING:
    from common.config import MeshConfig

GROUP: Final = "security"
SOON_DAYS = 30
WAY_OUT = "docs/design/security.md has the steps; labanmesh secure list shows who holds what"


@dataclass(frozen=True, slots=True)
class Security:
    """What was seen. name, roles, expires: of this machine's certificate; expires None where there is none.

    fault: why the credentials, or the endpoint with them, cannot be used: one line with the way out; "" where they can.
    """

    mesh: "MeshConfig"
    name: str = ""
    roles: tuple[str, ...] = ()
    expires: datetime | None = None
    fault: str = ""


def findings(security: Security, now: datetime) -> list[Finding]:
    """All that is to be said of it at `now` (with its time zone)."""
    return [*_certificate(security, now), *_fault(security), *_none(security)]


def _certificate(security: Security, now: datetime) -> Iterator[Finding]:
    if security.expires is None or now >= security.expires:
        return
    days = (security.expires - now).total_seconds() / 86400
    until = f"{security.expires:%Y-%m-%d}"
    what = f"certificate {security.name}{_for(security)}: valid for {days:.0f} more days, until {until}"
    if days > SOON_DAYS:
        yield ok(GROUP, what)
    else:
        machine = security.name.rpartition(".")[0] or security.name
        yield warning(GROUP, what, f"labanmesh secure renew SCENE {machine}, and copy the new folder here")


def _for(security: Security) -> str:
    return f" for {', '.join(security.roles)}" if security.roles else ""


def _fault(security: Security) -> Iterator[Finding]:
    if security.fault:
        yield told(GROUP, "error", security.fault, WAY_OUT)


def _none(security: Security) -> Iterator[Finding]:
    if security.fault:
        return
    if not security.mesh.credentials:
        yield ok(GROUP, "no credentials (mesh.credentials), so no encryption and no access rules")
    elif security.expires is None:
        yield error(GROUP, f"{security.mesh.credentials}: no certificate could be read", WAY_OUT)
