"""A private certificate authority: makes keys and certificates, as PEM bytes. Time is passed in, nothing is written.

EC keys on P-256 throughout: small, quick to check on a Raspberry Pi, understood by every TLS library.
"""

import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from common.zenoh_settings import ROLE_URI

AUTHORITY_DAYS = 3650
CERTIFICATE_DAYS = 365
BACKDATED = timedelta(hours=1)
"""A certificate is valid from a little before it was made: a machine without a battery may have a slow clock."""
USES = (
    *("digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_agreement"),
    *("key_cert_sign", "crl_sign", "encipher_only", "decipher_only"),
)


@dataclass(frozen=True, slots=True)
class KeyPair:
    """A certificate and its private key, each PEM; the key is not encrypted, the file's mode protects it."""

    certificate: bytes
    key: bytes


@dataclass(frozen=True, slots=True)
class SignedCertificate:
    """A machine's pair, with the facts that the register keeps."""

    pair: KeyPair
    serial: int
    expires: datetime


def make_authority(scenes: str, now: datetime, only_for: Sequence[str] = ()) -> KeyPair:
    """A new authority that signs itself, valid for AUTHORITY_DAYS; `now` is timezone-aware, `scenes` names it.

    only_for: domains and IP networks; a machine that trusts it does so for hosts in them alone (RFC 5280, 4.2.1.10).
    """
    key = ec.generate_private_key(ec.SECP256R1())
    name = _subject(f"labanmesh {scenes}"[:64])
    builder = (
        _builder(name, name, key.public_key(), now, now + timedelta(days=AUTHORITY_DAYS))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage("key_cert_sign crl_sign"), critical=True)
    )
    if only_for:
        builder = builder.add_extension(x509.NameConstraints(list(map(_network, only_for)), None), critical=True)
    return KeyPair(_pem(builder.sign(key, hashes.SHA256())), _key_pem(key))


def issue(
    authority: KeyPair,
    common_name: str,
    hosts: Sequence[str],
    now: datetime,
    *,
    roles: Sequence[str] = (),
    server: bool = False,
    days: float = CERTIFICATE_DAYS,
) -> SignedCertificate:
    """A certificate for `common_name`, signed by `authority`, valid for `days` but never longer than the authority.

    hosts: DNS names or IP addresses by which its holder is reached. roles: as `Roles.words` has them. server: it may be
    a TLS server, as a router may.
    """
    signer = x509.load_pem_x509_certificate(authority.certificate)
    signer_key = serialization.load_pem_private_key(authority.key, None)
    if not isinstance(signer_key, ec.EllipticCurvePrivateKey):
        raise ValueError("the authority's key is not an elliptic curve key")
    key = ec.generate_private_key(ec.SECP256R1())
    expires = min(now + timedelta(days=days), signer.not_valid_after_utc).replace(microsecond=0)
    purposes = [
        ExtendedKeyUsageOID.CLIENT_AUTH,
        *([ExtendedKeyUsageOID.SERVER_AUTH] if server or "router" in roles else []),
    ]
    builder = (
        _builder(_subject(common_name), signer.subject, key.public_key(), now, expires)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage("digital_signature"), critical=True)
        .add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signer_key.public_key()), critical=False)
    )
    names = [*map(_host, hosts), *(x509.UniformResourceIdentifier(ROLE_URI + role) for role in roles)]
    if names:
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    certificate = builder.sign(signer_key, hashes.SHA256())
    return SignedCertificate(KeyPair(_pem(certificate), _key_pem(key)), certificate.serial_number, expires)


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, begins: datetime, expires: datetime
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        # Tests make certificates that have expired already: the beginning lies before their end too.
        .not_valid_before(min(begins, expires) - BACKDATED)
        .not_valid_after(expires)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _subject(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _network(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_network(name))
    except ValueError:
        return x509.DNSName(name)


def _usage(allowed: str) -> x509.KeyUsage:
    return x509.KeyUsage(**{use: use in allowed.split() for use in USES})


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    encoding, format_ = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    return key.private_bytes(encoding, format_, serialization.NoEncryption())
