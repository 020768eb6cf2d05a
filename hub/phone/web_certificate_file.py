"""The certificate of the phone's page: an authority of its own, made once, which is trusted for private networks alone.

1. The authority's key lies in the user's data folder, readable by this user only. Whoever installs its certificate
   trusts it for private addresses and local names, and for nothing on the internet (`NETWORKS`).
2. The page's certificate is made anew when this machine's address is not in it, or when it expires within RENEW_DAYS.
3. Where `--certificate FOLDER` names one that `labanmesh secure add SCENE NAME --router` made, that is used as it is.
"""

import hashlib
import os
import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from common.certificate_authority import KeyPair, issue, make_authority
from common.credentials import check_credentials
from common.errors import BadInput, LabanmeshError, reason_of
from common.files import open_private, replace_file
from common.zenoh_settings import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE

NETWORKS = (
    *("10.0.0.0/8", "172.16.0.0/12", "192.168.0.0/16", "169.254.0.0/16", "127.0.0.0/8", "100.64.0.0/10"),
    *("fc00::/7", "fe80::/10", "::1/128", "local", "lan", "home", "home.arpa", "internal", "localhost"),
)
"""Private, link-local and shared addresses (RFC 1918, 3927, 6598, 4193, 4291), and the names of homes' networks."""
AUTHORITY_KEY = "ca-key.pem"
RENEW_DAYS = 30
DAYS = 365.0
"""Telephones refuse a certificate for longer than 825 days."""


@dataclass(frozen=True, slots=True)
class WebCertificate:
    """context: for the server. authority: its certificate, DER, which a phone may install; fingerprint: of that."""

    context: ssl.SSLContext
    authority: bytes

    @property
    def fingerprint(self) -> str:
        """SHA-256, in pairs of digits, as phones show it."""
        digits = hashlib.sha256(self.authority).hexdigest().upper()
        return " ".join(digits[place : place + 2] for place in range(0, len(digits), 2))


def given_certificate(folder: Path) -> WebCertificate:
    """The certificate in a folder of `labanmesh secure`; raises BadInput unless it is for a server and in force."""
    if (fault := check_credentials(folder, datetime.now(UTC))) is not None:
        raise BadInput(f"--certificate {folder}: {fault}")
    certificate = x509.load_pem_x509_certificate((folder / CERTIFICATE_FILE).read_bytes())
    usage = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    if ExtendedKeyUsageOID.SERVER_AUTH not in usage:
        raise BadInput(
            f"--certificate {folder}: not for a server; labanmesh secure add SCENE NAME --router --host HOST makes one"
        )
    return _loaded(folder)


def own_certificate(folder: Path, hosts: Sequence[str]) -> WebCertificate:
    """A certificate for `hosts`, signed by the authority in `folder`; both are made where they are missing.

    Raises BadInput for a host outside of NETWORKS, LabanmeshError for a folder that cannot be written.
    """
    now = datetime.now(UTC)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.chmod(0o700)
        if not (folder / AUTHORITY_KEY).exists():
            pair = make_authority("phone", now, only_for=NETWORKS)
            _write_private(folder / AUTHORITY_KEY, pair.key)
            replace_file(folder / AUTHORITY_FILE, pair.certificate)
        if not _is_good(folder / CERTIFICATE_FILE, hosts, now):
            authority = KeyPair((folder / AUTHORITY_FILE).read_bytes(), (folder / AUTHORITY_KEY).read_bytes())
            pair = issue(authority, "labanmesh phone", hosts, now, server=True, days=DAYS).pair
            _write_private(folder / KEY_FILE, pair.key)
            replace_file(folder / CERTIFICATE_FILE, pair.certificate)
        return _loaded(folder)
    except OSError as error:
        raise LabanmeshError(f"{folder}: {reason_of(error)}; the certificate of the phone's page lies there") from None


def _is_good(path: Path, hosts: Sequence[str], now: datetime) -> bool:
    """Whether the certificate names all hosts and is in force for long enough."""
    try:
        certificate = x509.load_pem_x509_certificate(path.read_bytes())
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (OSError, ValueError, x509.ExtensionNotFound):
        return False
    held = {*names.get_values_for_type(x509.DNSName), *map(str, names.get_values_for_type(x509.IPAddress))}
    return held >= set(hosts) and certificate.not_valid_after_utc - now > timedelta(days=RENEW_DAYS)


def _loaded(folder: Path) -> WebCertificate:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(folder / CERTIFICATE_FILE, folder / KEY_FILE)
        authority = ssl.PEM_cert_to_DER_cert((folder / AUTHORITY_FILE).read_text("ascii"))
    except (ssl.SSLError, ValueError):
        raise BadInput(f"{folder}: its certificate cannot be used; remove the folder, and a new one is made") from None
    return WebCertificate(context, authority)


def _write_private(path: Path, content: bytes) -> None:
    with os.fdopen(open_private(path), "wb") as file:
        file.write(content)
