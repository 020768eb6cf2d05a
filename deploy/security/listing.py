"""The register for people and for programs. Pure."""

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from deploy.security.register import Machine

HEAD = ("certificate", "for", "state", "days left", "expires")


def state_of(machine: Machine, now: datetime) -> str:
    """`in force`, `revoked` or `expired`."""
    if machine.revoked is not None:
        return "revoked"
    return "in force" if machine.days_left(now) > 0 else "expired"


def as_rows(machines: Sequence[Machine], now: datetime) -> list[dict[str, Any]]:
    """One map a certificate, for --json: what the register holds, its state and the days left."""
    return [
        {
            "name": machine.name,
            "common_name": machine.common_name,
            "roles": list(machine.roles.words),
            "hosts": list(machine.hosts),
            "serial": machine.serial,
            "state": state_of(machine, now),
            "days_left": round(machine.days_left(now), 1),
            "expires": machine.expires.isoformat(),
            "revoked": machine.revoked.isoformat() if machine.revoked else None,
        }
        for machine in machines
    ]


def as_table(machines: Sequence[Machine], now: datetime) -> str:
    """Lines for people, one a certificate."""
    cells = [HEAD, *(_cells(machine, now) for machine in machines)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join("  ".join(f"{cell:<{w}}" for cell, w in zip(row, widths, strict=True)).rstrip() for row in cells)


def _cells(machine: Machine, now: datetime) -> tuple[str, ...]:
    days = f"{machine.days_left(now):.0f}"
    return (machine.common_name, str(machine.roles), state_of(machine, now), days, f"{machine.expires:%Y-%m-%d}")
