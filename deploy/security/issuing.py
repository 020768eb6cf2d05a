"""The authority's folder: its key, its register, and a folder of credentials for each certificate.

1. No key is ever overwritten: each certificate has a folder of its own, named by its common name.
2. The register is replaced as a whole, last, so that a crash leaves the old one or the new one.
3. The router's configuration is written anew at each change.
"""

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from common.errors import BadInput, LabanmeshError
from common.zenoh_settings import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE
from deploy.security.authority import CERTIFICATE_DAYS, Issued, Pair, issue, make_authority
from deploy.security.register import Machine, Register, Roles
from deploy.security.router_config import listening, router_config

if TYPE_CHECKING:
    from common.config import Scene

AUTHORITY_KEY, REGISTER, ROUTER = "ca-key.pem", "register.json", "router.json5"
FOLDER = "secure"
"""The authority's folder, beside the scene file."""


@dataclass(frozen=True, slots=True)
class Authority:
    """An authority in its folder. Made by `found` and `opened`."""

    folder: Path
    pair: Pair
    register: Register

    def add(
        self,
        scene: "Scene",
        name: str,
        roles: Roles,
        hosts: Sequence[str],
        now: datetime,
        days: float = CERTIFICATE_DAYS,
    ) -> Path:
        """A certificate for a machine that has none in force; returns its folder. Raises BadInput if it has one."""
        held = [machine for machine in self.register.of(name) if machine.revoked is None]
        if held:
            raise BadInput(
                f"{name!r}: has certificate {held[-1].common_name}; labanmesh secure renew SCENE {name}, "
                f"or revoke it first to give it other roles"
            )
        return self._issue(scene, name, roles, hosts, now, days)

    def renew(
        self, scene: "Scene", name: str, hosts: Sequence[str], now: datetime, days: float = CERTIFICATE_DAYS
    ) -> Path:
        """The next certificate for a machine, with its roles, and its hosts or `hosts`; the old one counts on.

        Raises BadInput for a machine that has none in force.
        """
        last = self.register.newest(name)
        if last.revoked is not None:
            raise BadInput(f"{name!r}: {last.common_name} was revoked; labanmesh secure add SCENE {name}")
        return self._issue(scene, name, last.roles, hosts or last.hosts, now, days)

    def revoke(self, scene: "Scene", name: str, now: datetime) -> tuple[str, ...]:
        """Take away what the certificates of `name`, or the one `NAME.GENERATION`, may do; returns which they were."""
        register, gone = self.register.revoke(name, now)
        self._keep(scene, register)
        return gone

    def _issue(self, scene: "Scene", name: str, roles: Roles, hosts: Sequence[str], now: datetime, days: float) -> Path:
        generation = 1 + max((machine.generation for machine in self.register.of(name)), default=0)
        common_name = f"{name}.{generation}"
        issued = issue(self.pair, common_name, hosts, now, roles=roles.words, days=days)
        place = self._lay_out(common_name, issued)
        machine = Machine(
            name=name,
            generation=generation,
            roles=roles,
            hosts=tuple(hosts),
            serial=f"{issued.serial:x}",
            expires=issued.expires,
        )
        self._keep(scene, self.register.with_(machine))
        return place

    def _lay_out(self, common_name: str, issued: Issued) -> Path:
        place = self.folder / common_name
        try:
            place.mkdir(mode=0o700)
        except FileExistsError:
            raise BadInput(f"{place}: is there, but not in the register; move it away") from None
        write_new(place / AUTHORITY_FILE, self.pair.certificate, 0o644)
        write_new(place / CERTIFICATE_FILE, issued.pair.certificate, 0o644)
        write_new(place / KEY_FILE, issued.pair.key, 0o600)
        return place

    def _keep(self, scene: "Scene", register: Register) -> None:
        replace_text(self.folder / REGISTER, register.to_json())
        if scene.mesh.credentials:
            text = router_config(scene, register, [listening(scene.mesh.endpoint)])
            replace_text(self.folder / ROUTER, text)


def found(folder: Path, scene: "Scene", now: datetime) -> Authority:
    """A new authority for `scene` in `folder`, which only this user may enter; raises BadInput if one is there."""
    if (folder / AUTHORITY_KEY).exists() or (folder / REGISTER).exists():
        raise BadInput(f"{folder}: an authority is there; keys are never overwritten; labanmesh secure list SCENE")
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder.chmod(0o700)
    pair = make_authority(scene.scene, now)
    write_new(folder / AUTHORITY_KEY, pair.key, 0o600)
    write_new(folder / AUTHORITY_FILE, pair.certificate, 0o644)
    authority = Authority(folder, pair, Register(scene.scene))
    authority._keep(scene, authority.register)
    return authority


def opened(folder: Path, scene: "Scene") -> Authority:
    """The authority in `folder`; raises BadInput if there is none, or another scene's."""
    register = read_register(folder / REGISTER, scene)
    try:
        pair = Pair((folder / AUTHORITY_FILE).read_bytes(), (folder / AUTHORITY_KEY).read_bytes())
    except OSError as error:
        raise BadInput(f"{error.filename}: {(error.strerror or str(error)).lower()}; only the machine with the "
                       "authority's key can issue and revoke") from None  # fmt: skip
    return Authority(folder, pair, register)


def read_register(path: Path, scene: "Scene") -> Register:
    """The register at `path`; raises BadInput if there is none, or another scene's."""
    try:
        register = Register.from_json(path.read_text(encoding="utf-8"), str(path))
    except OSError as error:
        said = (error.strerror or str(error)).lower()
        raise BadInput(f"{path}: {said}; labanmesh secure init SCENE makes an authority") from None
    if register.scene != scene.scene:
        raise BadInput(f"{path}: the authority of scene {register.scene!r}, not of {scene.scene!r}; each has its own")
    return register


def write_new(path: Path, content: bytes, mode: int) -> None:
    """A file that was not there before, with `mode` from its first moment on."""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(content)


def replace_text(path: Path, text: str) -> None:
    """`text` in the place of what was there, at once; raises LabanmeshError."""
    try:
        with tempfile.NamedTemporaryFile("w", dir=path.parent, encoding="utf-8", delete=False) as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        # No secrets in these; the router may run as another user.
        Path(file.name).chmod(0o644)
        Path(file.name).replace(path)
    except OSError as error:
        raise LabanmeshError(f"{path}: cannot be written: {(error.strerror or str(error)).lower()}") from None
