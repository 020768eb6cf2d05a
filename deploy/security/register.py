"""The authority's register: which certificate was issued to which machine, for what, until when. Pure.

A machine's certificates are numbered: `cam1.1`, after renewal `cam1.2`. The number is in the common name, so that the
old one can be refused while the new one counts: Zenoh reads no revocation lists, its access rules name common names.
"""

from dataclasses import dataclass, replace
from datetime import datetime

from pydantic import BaseModel, ConfigDict, ValidationError

from common.errors import BadInput

VERSION = 1


class Roles(BaseModel):
    """What a machine is there for; one machine may be several."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    observers: tuple[str, ...] = ()
    fusions: tuple[str, ...] = ()
    hub: bool = False
    router: bool = False

    @property
    def words(self) -> tuple[str, ...]:
        """As the certificate carries them: `observer:cam1`, `fusion:fusion`, `hub`, `router`."""
        named = [*(f"observer:{name}" for name in self.observers), *(f"fusion:{name}" for name in self.fusions)]
        return (*named, *(("hub",) if self.hub else ()), *(("router",) if self.router else ()))

    def __str__(self) -> str:
        return ", ".join(self.words).replace(":", " ")


class Machine(BaseModel):
    """One certificate. hosts: by which names it is reached; serial: hexadecimal; expires: with its time zone."""

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
        """How the certificate names its holder: `NAME.GENERATION`."""
        return f"{self.name}.{self.generation}"

    def days_left(self, now: datetime) -> float:
        """Days until it expires, negative after that."""
        return (self.expires - now).total_seconds() / 86400


class _File(BaseModel):
    """What the register's file holds."""

    model_config = ConfigDict(extra="forbid")
    version: int = VERSION
    scene: str
    certificates: list[Machine] = []


@dataclass(frozen=True, slots=True)
class Register:
    """All certificates that the authority of `scene` has issued, oldest first."""

    scene: str
    machines: tuple[Machine, ...] = ()

    def in_force(self) -> tuple[Machine, ...]:
        """Those that were not revoked; an expired one is refused by TLS itself."""
        return tuple(machine for machine in self.machines if machine.revoked is None)

    def of(self, name: str) -> tuple[Machine, ...]:
        """The certificates of the machine `name`, oldest first."""
        return tuple(machine for machine in self.machines if machine.name == name)

    def newest(self, name: str) -> Machine:
        """The newest certificate of the machine `name`; raises BadInput for a name that has none."""
        found = self.of(name)
        if not found:
            known = ", ".join(dict.fromkeys(machine.name for machine in self.machines)) or "none yet"
            raise BadInput(f"{name!r}: no such machine in the register; known: {known}")
        return found[-1]

    def with_(self, machine: Machine) -> "Register":
        """The register with one more certificate."""
        return replace(self, machines=(*self.machines, machine))

    def revoke(self, name: str, now: datetime) -> tuple["Register", tuple[str, ...]]:
        """Without `name`: a machine, or one certificate `NAME.GENERATION`; and the common names that it concerned.

        Raises BadInput when there is nothing in force under that name.
        """
        meant = [machine for machine in self.in_force() if name in (machine.name, machine.common_name)]
        if not meant:
            known = ", ".join(machine.common_name for machine in self.in_force()) or "none"
            raise BadInput(f"{name!r}: no certificate in force has this name; in force: {known}")
        machines = tuple(m.model_copy(update={"revoked": now}) if m in meant else m for m in self.machines)
        return replace(self, machines=machines), tuple(machine.common_name for machine in meant)

    def to_json(self) -> str:
        """As text: what `from_json` reads."""
        return _File(scene=self.scene, certificates=list(self.machines)).model_dump_json(indent=1) + "\n"

    @classmethod
    def from_json(cls, text: str, where: str) -> "Register":
        """The register in `text`; raises BadInput that names `where` it was read."""
        try:
            said = _File.model_validate_json(text)
        except ValidationError as error:
            first = error.errors()[0]
            at = ".".join(str(part) for part in first["loc"])
            raise BadInput(f"{where}: no register of labanmesh: {at} {first['msg']}".replace("\n", " ")) from None
        if said.version != VERSION:
            raise BadInput(f"{where}: version {said.version}, this labanmesh reads {VERSION}; use one as new")
        return cls(said.scene, tuple(said.certificates))
