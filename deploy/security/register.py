"""The authority's register: which certificate was issued to which machine, for what, until when. Pure.

A machine's certificates are numbered: `cam1.1`, after renewal `cam1.2`. The number is in the common name, so that the
old one can be refused while the new one counts: Zenoh reads no revocation lists, its access rules name common names.

In an authority of one scene a role names an id alone: `cam1`. In one of several scenes it is `SCENE/ID` for one scene
and `ID` for all of them, scenes that are added later included.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from common.errors import BadInput

REGISTER_VERSION = 2
"""Of the file's form."""
TABLE_HEAD = ("certificate", "for", "state", "days left", "expires")


class Roles(BaseModel):
    """The roles of a machine; it may have several.

    hub_of: the scenes of a hub that is not one of all scenes. pictures: what it may listen to as a hub includes live
    pictures. teach: as a hub it may also teach the observers. history: as a hub it may also show the history.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    observers: tuple[str, ...] = ()
    fusions: tuple[str, ...] = ()
    hub: bool = False
    hub_of: tuple[str, ...] = ()
    router: bool = False
    pictures: bool = False
    teach: bool = False
    history: bool = False

    @property
    def words(self) -> tuple[str, ...]:
        """The roles as the certificate carries them: `observer:cam1`, `fusion:home/fusion`, `hub`, `hub:home`."""
        flags = [name for name in ("hub", "router", "pictures", "teach", "history") if getattr(self, name)]
        by_id = [("observer", self.observers), ("fusion", self.fusions), ("hub", self.hub_of)]
        words = [f"{kind}:{name}" for kind, names in by_id for name in names]
        return (*words, *flags)

    def observers_in(self, scene: str) -> tuple[str, ...]:
        """The observers that it may be in `scene`."""
        return tuple(_ids(self.observers, scene))

    def fusions_in(self, scene: str) -> tuple[str, ...]:
        """The fusion services that it may be in `scene`."""
        return tuple(_ids(self.fusions, scene))

    def is_hub_in(self, scene: str) -> bool:
        """Whether it may listen to `scene`."""
        return self.hub or scene in self.hub_of

    def only_in(self, scene: str) -> "Roles":
        """The same roles, for `scene` and no other one."""
        observers, fusions = (tuple(f"{scene}/{name}" for name in names) for names in (self.observers, self.fusions))
        scoped = {"observers": observers, "fusions": fusions, "hub": False, "hub_of": (scene,) if self.hub else ()}
        return self.model_copy(update=scoped)

    def __str__(self) -> str:
        return ", ".join(self.words).replace(":", " ")


class IssuedCertificate(BaseModel):
    """One certificate. hosts: by which names its machine is reached; serial: hexadecimal; expires: with time zone."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    name: str
    generation: int
    roles: Roles
    hosts: tuple[str, ...] = ()
    serial: str
    expires: datetime
    revoked: datetime | None = None

    @property
    def common_name(self) -> str:
        """The name of its holder in the certificate: `NAME.GENERATION`."""
        return f"{self.name}.{self.generation}"

    def days_left(self, now: datetime) -> float:
        """Days until it expires, negative after that."""
        return (self.expires - now).total_seconds() / 86400

    def state(self, now: datetime) -> str:
        """`in force`, `revoked` or `expired`."""
        if self.revoked is not None:
            return "revoked"
        return "in force" if self.days_left(now) > 0 else "expired"


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")
    version: int
    scenes: tuple[str, ...]
    certificates: list[IssuedCertificate]


@dataclass(frozen=True, slots=True)
class Register:
    """All certificates that the authority of `scenes` has issued, oldest first."""

    scenes: tuple[str, ...]
    certificates: tuple[IssuedCertificate, ...] = ()

    def in_force(self) -> tuple[IssuedCertificate, ...]:
        """The certificates that were not revoked; TLS itself refuses an expired one."""
        return tuple(each for each in self.certificates if each.revoked is None)

    def of(self, name: str) -> tuple[IssuedCertificate, ...]:
        """The certificates of the machine `name`, oldest first."""
        return tuple(each for each in self.certificates if each.name == name)

    def newest(self, name: str) -> IssuedCertificate:
        """The newest certificate of the machine `name`; raises BadInput for a name that has none."""
        certificates = self.of(name)
        if not certificates:
            known = ", ".join(dict.fromkeys(each.name for each in self.certificates)) or "none yet"
            raise BadInput(f"{name!r}: no such machine in the register; known: {known}")
        return certificates[-1]

    def with_scenes(self, scenes: Iterable[str]) -> "Register":
        """The register with more scenes; certificates of an authority of one scene stay for that scene alone."""
        register = self
        if len(self.scenes) == 1:
            (only,) = self.scenes
            scoped = (each.model_copy(update={"roles": each.roles.only_in(only)}) for each in self.certificates)
            register = replace(self, certificates=tuple(scoped))
        return replace(register, scenes=tuple(dict.fromkeys([*self.scenes, *scenes])))

    def revoke(self, name: str, now: datetime) -> tuple["Register", tuple[str, ...]]:
        """The register without a machine, or without one certificate `NAME.GENERATION`, and the common names revoked.

        Raises BadInput when there is nothing in force under that name.
        """
        revoked = [each for each in self.in_force() if name in (each.name, each.common_name)]
        if not revoked:
            known = ", ".join(each.common_name for each in self.in_force()) or "none"
            raise BadInput(f"{name!r}: no certificate in force has this name; in force: {known}")
        rest = (c.model_copy(update={"revoked": now}) if c in revoked else c for c in self.certificates)
        return replace(self, certificates=tuple(rest)), tuple(each.common_name for each in revoked)

    def to_json(self) -> str:
        """The register as text, which `from_json` reads."""
        file = _File(version=REGISTER_VERSION, scenes=self.scenes, certificates=list(self.certificates))
        return file.model_dump_json(indent=1) + "\n"

    @classmethod
    def from_json(cls, text: str, where: str) -> "Register":
        """The register in `text`; raises BadInput that names `where` it was read."""
        try:
            file = _File.model_validate_json(text)
        except ValidationError as error:
            first = error.errors()[0]
            at = ".".join(str(part) for part in first["loc"])
            fault = f"{where}: not a register of labanmesh: {at} {first['msg']}".replace("\n", " ")
            raise BadInput(f"{fault}. Copy register.json again from the authority's folder") from None
        if file.version != REGISTER_VERSION or not file.scenes:
            raise BadInput(
                f"{where}: version {file.version} with {len(file.scenes)} scenes, this labanmesh reads version "
                f"{REGISTER_VERSION}. Install the version that wrote it"
            )
        return cls(file.scenes, tuple(file.certificates))


def as_rows(certificates: Sequence[IssuedCertificate], now: datetime) -> list[dict[str, Any]]:
    """One map a certificate, for --json: its entry in the register, its state and the days left."""
    return [
        {
            "name": each.name,
            "common_name": each.common_name,
            "roles": list(each.roles.words),
            "hosts": list(each.hosts),
            "serial": each.serial,
            "state": each.state(now),
            "days_left": round(each.days_left(now), 1),
            "expires": each.expires.isoformat(),
            "revoked": each.revoked.isoformat() if each.revoked else None,
        }
        for each in certificates
    ]


def as_table(certificates: Sequence[IssuedCertificate], now: datetime) -> str:
    """Lines for people, one a certificate."""
    rows = [TABLE_HEAD] + [
        (each.common_name, str(each.roles), each.state(now), f"{each.days_left(now):.0f}", f"{each.expires:%Y-%m-%d}")
        for each in certificates
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(f"{cell:<{w}}" for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows)


def _ids(names: Iterable[str], scene: str) -> Iterable[str]:
    for name in names:
        scene_name, _, own_id = name.rpartition("/")
        if scene_name in ("", scene):
            yield own_id
