"""The authority's folder: its key, its register, and a folder of credentials for each certificate.

1. No key is ever overwritten: each certificate has a folder of its own, named by its common name.
2. The register is replaced as a whole, last, so that a crash leaves the old one or the new one.
3. A lock file orders processes that change the register at the same time: each reads it anew under the lock.
"""

import fcntl
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from common.certificate_authority import CERTIFICATE_DAYS, KeyPair, issue, make_authority
from common.config import Scene, read_scene, scene_files
from common.errors import BadInput, LabanmeshError, reason_of
from common.files import read_text, replace_file, sync_folder
from common.zenoh_settings import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE
from deploy.security.register import IssuedCertificate, Register, Roles

AUTHORITY_KEY, REGISTER, LOCK = "ca-key.pem", "register.json", "lock"
SECURE_FOLDER = "secure"
"""The authority's folder, beside the scene file."""


@dataclass(frozen=True, slots=True)
class Authority:
    """The authority of `scenes` in its folder. Made by `create_authority` and `open_authority`."""

    folder: Path
    scenes: tuple[Scene, ...]
    pair: KeyPair

    @property
    def register(self) -> Register:
        """The register as it is now."""
        return read_register(self.folder / REGISTER, self.scenes)

    def add(
        self, name: str, roles: Roles, hosts: Sequence[str], now: datetime, days: float = CERTIFICATE_DAYS
    ) -> IssuedCertificate:
        """A certificate for a machine that has none in force, in a folder of its own; raises BadInput if it has one."""
        with _locked(self.folder):
            register = self.register
            held = [each for each in register.of(name) if each.revoked is None]
            if held:
                raise BadInput(
                    f"{name!r}: has certificate {held[-1].common_name}; labanmesh secure renew SCENE {name}, "
                    f"or revoke it first to give it other roles"
                )
            return self._issue(register, name, roles, hosts, now, days)

    def renew(
        self, name: str, hosts: Sequence[str], now: datetime, days: float = CERTIFICATE_DAYS
    ) -> IssuedCertificate:
        """The next certificate for a machine, with its roles, and its hosts or `hosts`; the old one stays in force.

        Raises BadInput for a machine that has none in force.
        """
        with _locked(self.folder):
            register = self.register
            last = register.newest(name)
            if last.revoked is not None:
                raise BadInput(f"{name!r}: {last.common_name} was revoked; labanmesh secure add SCENE {name}")
            return self._issue(register, name, last.roles, hosts or last.hosts, now, days)

    def revoke(self, name: str, now: datetime) -> tuple[str, ...]:
        """Revoke the certificates of the machine `name`, or the one `NAME.GENERATION`; returns their common names."""
        with _locked(self.folder):
            register, revoked = self.register.revoke(name, now)
            self._write(register)
        return revoked

    def _issue(
        self, register: Register, name: str, roles: Roles, hosts: Sequence[str], now: datetime, days: float
    ) -> IssuedCertificate:
        generation = 1 + max((each.generation for each in register.of(name)), default=0)
        common_name = f"{name}.{generation}"
        signed = issue(self.pair, common_name, hosts, now, roles=roles.words, days=days)
        self._lay_out(common_name, signed.pair)
        certificate = IssuedCertificate(
            name=name,
            generation=generation,
            roles=roles,
            hosts=tuple(hosts),
            serial=f"{signed.serial:x}",
            expires=signed.expires,
        )
        self._write(replace(register, certificates=(*register.certificates, certificate)))
        return certificate

    def _lay_out(self, common_name: str, pair: KeyPair) -> None:
        place = self.folder / common_name
        with _writing(place):
            try:
                place.mkdir(mode=0o700)
            except FileExistsError:
                raise BadInput(f"{place}: is there, but not in the register; move it away") from None
            _write_new(place / AUTHORITY_FILE, self.pair.certificate, 0o644)
            _write_new(place / CERTIFICATE_FILE, pair.certificate, 0o644)
            _write_new(place / KEY_FILE, pair.key, 0o600)

    def _write(self, register: Register) -> None:
        path = self.folder / REGISTER
        with _writing(path):
            replace_file(path, register.to_json().encode(), 0o644)
            # No secret is in it; the router may run as another user, whatever the umask is.
            path.chmod(0o644)


def read_scenes(paths: Sequence[Path]) -> tuple[Scene, ...]:
    """The scenes in the files, and in all *.toml of the folders, that one router admits.

    Raises BadInput for a scene that stands in two files, and for scenes that do not meet at one place.
    """
    scenes: list[Scene] = []
    for path in scene_files(paths):
        scene = read_scene(path)
        if scene.scene in (other.scene for other in scenes):
            raise BadInput(f"{path}: scene {scene.scene!r} is in two of the files; give each scene a name of its own")
        # Each scene file may have a folder of credentials of its own.
        own, first = scene.mesh, scenes[0].mesh if scenes else scene.mesh
        is_alike = own.model_copy(update={"credentials": first.credentials}) == first
        if not is_alike or bool(own.credentials) != bool(first.credentials):
            raise BadInput(
                f"{path}: another [mesh] than scene {scenes[0].scene!r}; scenes of one router need the same mode, "
                "endpoint and prefix, all with credentials or none"
            )
        scenes.append(scene)
    return tuple(scenes)


def create_authority(folder: Path, scenes: Sequence[Scene], now: datetime) -> Authority:
    """A new authority for `scenes` in `folder`, which only this user may enter.

    An authority that is there takes up scenes that it does not have yet. Raises BadInput when there are none.
    """
    with _writing(folder):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.chmod(0o700)
    with _locked(folder):
        if (folder / AUTHORITY_KEY).exists() or (folder / REGISTER).exists():
            return _extend(folder, scenes)
        pair = make_authority("+".join(scene.scene for scene in scenes), now)
        with _writing(folder):
            _write_new(folder / AUTHORITY_KEY, pair.key, 0o600)
            _write_new(folder / AUTHORITY_FILE, pair.certificate, 0o644)
        authority = Authority(folder, tuple(scenes), pair)
        authority._write(Register(tuple(scene.scene for scene in scenes)))
    return authority


def _extend(folder: Path, scenes: Sequence[Scene]) -> Authority:
    register = _read(folder / REGISTER)
    names = [scene.scene for scene in scenes]
    if not set(names) > set(register.scenes):
        raise BadInput(
            f"{folder}: an authority of {_listed(register.scenes)} is there; keys are never overwritten; "
            "labanmesh secure list SCENE. To add scenes to it name the files of all, old and new"
        )
    authority = Authority(folder, tuple(scenes), _read_pair(folder))
    authority._write(register.with_scenes(names))
    return authority


def open_authority(folder: Path, scenes: Sequence[Scene]) -> Authority:
    """The authority in `folder`; raises BadInput if there is none, or one of other scenes."""
    read_register(folder / REGISTER, scenes)
    return Authority(folder, tuple(scenes), _read_pair(folder))


def read_register(path: Path, scenes: Sequence[Scene]) -> Register:
    """The register at `path`; raises BadInput if there is none, or one of other scenes than all of `scenes`."""
    register = _read(path)
    names = [scene.scene for scene in scenes]
    if strange := [name for name in names if name not in register.scenes]:
        raise BadInput(
            f"{path}: the authority of {_listed(register.scenes)}, not of {_listed(strange)}; "
            "labanmesh secure init, with the files of all of them, adds scenes to it"
        )
    if missing := [name for name in register.scenes if name not in names]:
        raise BadInput(
            f"{path}: also the authority of {_listed(missing)}; name the files of all its scenes, or their folder"
        )
    return register


def _read(path: Path) -> Register:
    try:
        text = read_text(path)
    except OSError as error:
        raise BadInput(f"{path}: {reason_of(error)}; labanmesh secure init SCENE makes an authority") from None
    except ValueError as error:
        raise BadInput(f"{path}: {error}; restore the register from a copy of its folder") from None
    return Register.from_json(text, str(path))


def _read_pair(folder: Path) -> KeyPair:
    try:
        return KeyPair((folder / AUTHORITY_FILE).read_bytes(), (folder / AUTHORITY_KEY).read_bytes())
    except OSError as error:
        raise BadInput(f"{error.filename}: {reason_of(error)}; only the machine with the authority's key can issue "
                       "and revoke") from None  # fmt: skip


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Until the block is left no other process changes the register in `folder`."""
    if not folder.is_dir():
        raise BadInput(f"{folder}: no such folder; labanmesh secure init SCENE makes an authority")
    with _writing(folder), os.fdopen(os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o600), "rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        where = error.filename or path
        raise LabanmeshError(f"cannot write {where}: {reason_of(error)}. Name another folder with --to") from None


def _listed(names: Sequence[str]) -> str:
    return f"scene{'s' * (len(names) > 1)} {', '.join(map(repr, names))}"


def _write_new(path: Path, content: bytes, mode: int) -> None:
    """A file that was not there before, with `mode` from its first moment on; on the disk before it is used."""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    sync_folder(path.parent)
