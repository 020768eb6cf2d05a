"""This machine's credentials: ca.pem, certificate.pem and key.pem in one folder, and checks of them."""

import os
import stat
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization
from cryptography.x509.oid import NameOID

from common.errors import BadInput, reason_of
from common.zenoh_settings import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, ROLE_URI

OPTION = {"observer": "--observer {}", "fusion": "--fusion {}", "hub": "--hub", "router": "--router"}
OTHERS_MODE = stat.S_IRWXG | stat.S_IRWXO


@dataclass(frozen=True, slots=True)
class MeshFault:
    """The reason why this machine cannot join the mesh, and the remedy: one line each."""

    what: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.what}; {self.remedy}"


@dataclass(frozen=True, slots=True)
class Certificate:
    """The content of a certificate that labanmesh uses.

    roles: `observer:cam1`, `fusion:fusion`, `hub`, `router`, `pictures`, `teach`, `history`; for one scene of several
    `observer:home/cam1`, `hub:home`.
    """

    common_name: str
    begins: datetime
    expires: datetime
    roles: tuple[str, ...] = ()

    def days_left(self, now: datetime) -> float:
        """Days until it expires, negative after that; `now` with its time zone."""
        return (self.expires - now).total_seconds() / 86400

    def is_for(self, role: str, process_id: str = "", scene: str = "") -> bool:
        """Whether its holder may have `role`, under an id and in a scene if they are named.

        A certificate that names no roles is for all of them, and a role that names no scene for every scene.
        """
        return not self.roles or any(_permits(word, role, process_id, scene) for word in self.roles)


def _permits(word: str, role: str, process_id: str, scene: str) -> bool:
    kind, _, name = word.partition(":")
    own_scene, _, own_id = (name, "", process_id) if kind == "hub" else name.rpartition("/")
    return kind == role and process_id in ("", own_id) and (not scene or own_scene in ("", scene))


def read_certificate(path: Path) -> Certificate:
    """The first certificate in the PEM file at `path`; raises BadInput, one line, if there is none."""
    return _describe(_load(path))


def own_certificate(folder: Path) -> Certificate:
    """The certificate in a folder of credentials; raises BadInput."""
    return read_certificate(folder / CERTIFICATE_FILE)


def check_credentials(folder: Path, now: datetime) -> MeshFault | None:
    """Why the credentials in `folder` cannot be used at `now`, without using the network; None if they can."""
    copy = "copy the folder here that `labanmesh secure add` made for this machine"
    if not folder.is_dir():
        return MeshFault(f"mesh.credentials = '{folder}': no such folder", copy)
    authority, certificate, key = (folder / name for name in (AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE))
    for path in (authority, certificate, key):
        if not path.is_file():
            return MeshFault(f"{path}: missing", copy)
        if not os.access(path, os.R_OK):
            return MeshFault(f"{path}: this process may not read it", "make the user who runs labanmesh its owner")
    mode = stat.S_IMODE(key.stat().st_mode)
    if os.name == "posix" and mode & OTHERS_MODE:
        return MeshFault(f"{key}: others can read it (mode {mode:04o})", f"chmod 600 {key}")
    try:
        return _mismatch(authority, certificate, key) or _validity_fault(certificate, now)
    except BadInput as error:
        return MeshFault(str(error), copy)


def require_credentials(folder: Path, role: str, process_id: str, now: datetime, scene: str = "") -> None:
    """Raises BadInput, one line, if the credentials cannot be used, or not for this role, id and scene."""
    fault = check_credentials(folder, now) or role_fault(folder, role, process_id, scene)
    if fault is not None:
        raise BadInput(str(fault))


def role_fault(folder: Path, role: str, process_id: str = "", scene: str = "") -> MeshFault | None:
    """Why this machine's certificate is not for a role (under an id, in a scene); None if it is. Raises BadInput."""
    ours = own_certificate(folder)
    # A standby fusion service is a fusion service, too.
    role = "fusion" if role == "standby" else role
    if ours.is_for(role, process_id, scene):
        return None
    of_scenes = any("/" in word or word.startswith("hub:") for word in ours.roles)
    wanted = "/".join(filter(None, [scene if of_scenes else "", process_id]))
    asked = f"{role} {wanted}".strip()
    has = ", ".join(ours.roles).replace(":", " ")
    return MeshFault(
        f"{folder / CERTIFICATE_FILE}: certificate {ours.common_name} is for {has}, not for {asked}",
        f"labanmesh secure add SCENE NAME {OPTION[role].format(wanted or 'ID')}, and copy the new folder here",
    )


def admission_fault(folder: Path, endpoint: str) -> MeshFault:
    """The fault if TLS works and the router does not answer."""
    name = own_certificate(folder).common_name
    return MeshFault(
        f"mesh.endpoint = {endpoint!r}: the router's access rules do not know certificate {name}: revoked, superseded, "
        "or issued after the rules that it has",
        "on the authority's machine `labanmesh secure list SCENE`, then copy the newest folder here, or the new "
        "rules to the router",
    )


def _mismatch(authority: Path, certificate: Path, key: Path) -> MeshFault | None:
    """The fault if the three files do not belong together."""
    ours, signer = _load(certificate), _load(authority)
    copy = "copy all three files from the folder that `labanmesh secure add` made for this machine"
    try:
        private = serialization.load_pem_private_key(key.read_bytes(), None)
    except (ValueError, TypeError) as error:
        raise BadInput(f"{key}: no private key in PEM form without a password") from error
    if private.public_key() != ours.public_key():
        return MeshFault(f"{key}: not the key of {certificate}", copy)
    try:
        ours.verify_directly_issued_by(signer)
    except (ValueError, TypeError, InvalidSignature):
        return MeshFault(f"{certificate}: not signed by the authority in {authority}", copy)
    return None


def _validity_fault(path: Path, now: datetime) -> MeshFault | None:
    ours = read_certificate(path)
    name = ours.common_name.rpartition(".")[0] or ours.common_name
    if now > ours.expires:
        what = f"{path}: this machine's certificate {ours.common_name} expired on {ours.expires:%Y-%m-%d}"
        return MeshFault(what, f"labanmesh secure renew SCENE {name}, and copy the new folder here")
    if now < ours.begins:
        what = (
            f"{path}: this machine's certificate {ours.common_name} is valid only from {ours.begins:%Y-%m-%d %H:%M} UTC"
        )
        return MeshFault(what, f"set this machine's clock, which says {now:%Y-%m-%d %H:%M} UTC")
    return None


def _load(path: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except ValueError:
        raise BadInput(f"{path}: no certificate in PEM form") from None
    except OSError as error:
        raise BadInput(f"{path}: {reason_of(error)}") from None


def _describe(certificate: x509.Certificate) -> Certificate:
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    common_name = str(names[0].value) if names else ""
    try:
        other = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        uris = other.get_values_for_type(x509.UniformResourceIdentifier)
    except x509.ExtensionNotFound:
        uris = []
    roles = tuple(uri.removeprefix(ROLE_URI) for uri in uris if uri.startswith(ROLE_URI))
    return Certificate(common_name, certificate.not_valid_before_utc, certificate.not_valid_after_utc, roles)
