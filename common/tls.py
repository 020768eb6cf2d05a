"""Probes an endpoint that cannot be used, without Zenoh, whose error message is the same for all causes.

1. The probe checks this machine's files, then whether anything listens, then the certificates of both sides.
2. With TLS 1.3 a server checks our certificate only when our side is done: the probe waits a moment for its alert.
"""

import re
import socket
import ssl
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from common.credentials import MeshFault, check_credentials, read_certificate
from common.errors import reason_of
from common.zenoh_settings import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE

if TYPE_CHECKING:
    from common.config import MeshConfig

ENDPOINT_TIMEOUT_S = 2.0
ALERT_S = 0.5
"""How long a server may take to reject our certificate: a round trip, and a reserve for a slow server."""
ADDRESS = re.compile(r"(?P<protocol>\w+)/(?:\[(?P<six>[^\]]+)\]|(?P<host>[^/\[\]]+)):(?P<port>\d+)([#?].*)?\Z")
GREETING_S = 1.0
"""How long a TLS server may take to answer a handshake: Zenoh pauses for 0.1 s after each that failed."""
EXPIRED, NOT_YET, WRONG_NAMES, FOREIGN = 10, 9, (62, 64), (7, 18, 19, 20, 21)
"""OpenSSL's verification results (X509_V_ERR_...)."""
START = "start it with `labanmesh router --scene SCENE` or correct the address"
CERTIFY = "make credentials for this machine with `labanmesh secure add SCENE NAME`, and name the folder"


def endpoint_fault(mesh: "MeshConfig", now: datetime, timeout_s: float = ENDPOINT_TIMEOUT_S) -> MeshFault | None:
    """Why this machine cannot connect to `mesh.endpoint`; None if nothing is wrong up to TLS.

    now: with its time zone. Each network operation waits at most `timeout_s`. For quic, udp and ws endpoints only the
    files are checked.
    """
    folder = Path(mesh.credentials)
    if mesh.credentials and (fault := check_credentials(folder, now)) is not None:
        return fault
    address = ADDRESS.match(mesh.endpoint)
    if address is None or address["protocol"] not in ("tcp", "tls"):
        return None
    host, port = address["six"] or address["host"], int(address["port"])
    try:
        with socket.create_connection((host, port), timeout_s) as plain:
            if address["protocol"] == "tcp":
                return _plain_fault(mesh.endpoint, plain, min(timeout_s, GREETING_S))
            if not mesh.credentials:
                return MeshFault(f"mesh.endpoint = {mesh.endpoint!r} needs mesh.credentials, which is empty", CERTIFY)
            return _tls_fault(mesh.endpoint, plain, host, folder)
    except OSError as error:
        return _connection_fault(mesh.endpoint, error)


def _connection_fault(endpoint: str, error: OSError) -> MeshFault:
    setting = f"mesh.endpoint = {endpoint!r}"
    if isinstance(error, ConnectionRefusedError):
        return MeshFault(f"{setting}: no router answers there", START)
    if isinstance(error, socket.gaierror):
        return MeshFault(f"{setting}: this name is not known here", "correct it, or write the address as a number")
    if isinstance(error, TimeoutError):
        return MeshFault(f"{setting}: no answer", "correct the address, start that machine, or open its firewall")
    return MeshFault(f"{setting}: cannot be reached: {reason_of(error)}", "connect this machine to the network")


def _plain_fault(endpoint: str, plain: socket.socket, timeout_s: float) -> MeshFault | None:
    """Without TLS on our side: a router that requires TLS answers a TLS handshake, another one does not."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    plain.settimeout(timeout_s)
    try:
        context.wrap_socket(plain).close()
    except ssl.SSLError as error:
        if not _is_alert(error):
            return None
    except OSError:
        return None
    return MeshFault(f"mesh.endpoint = {endpoint!r}: the router there accepts TLS only, and this is plain tcp", (
        'write tls/HOST:PORT and mesh.credentials in the scene file, see `labanmesh secure --help`'
    ))  # fmt: skip


def _tls_fault(endpoint: str, plain: socket.socket, host: str, folder: Path) -> MeshFault | None:
    """With TLS on our side: whether each side accepts the other's certificate."""
    setting = f"mesh.endpoint = {endpoint!r}"
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(folder / AUTHORITY_FILE)
    context.load_cert_chain(folder / CERTIFICATE_FILE, folder / KEY_FILE)
    try:
        private = context.wrap_socket(plain, server_hostname=host)
    except ssl.SSLCertVerificationError as error:
        return _router_fault(setting, host, folder, error)
    except OSError as error:
        return _own_fault(setting, folder, error) if _is_alert(error) else _no_tls(setting)
    with private:
        private.settimeout(ALERT_S)
        try:
            private.recv(1)
        except TimeoutError:
            return None  # no alert: the router waits for us to begin
        except OSError as error:
            return _own_fault(setting, folder, error)
    return _own_fault(setting, folder, OSError("closed without a reason"))


def _is_alert(error: OSError) -> bool:
    """Whether the other side sent a TLS alert; after any other error it speaks no TLS at all."""
    return isinstance(error, ssl.SSLError) and "ALERT" in (error.reason or "")


def _no_tls(setting: str) -> MeshFault:
    return MeshFault(
        f"{setting}: what listens there speaks no TLS",
        "start the router secured (`labanmesh router --scene SCENE`), or correct the port if another program has it",
    )


def _router_fault(setting: str, host: str, folder: Path, error: ssl.SSLCertVerificationError) -> MeshFault:
    """The fault of the router's certificate."""
    if error.verify_code == EXPIRED:
        return MeshFault(f"{setting}: the router's certificate has expired", (
            "renew it with `labanmesh secure renew` and copy it to the router, or set this machine's clock"
        ))  # fmt: skip
    if error.verify_code == NOT_YET:
        return MeshFault(f"{setting}: the router's certificate is not valid yet", "set this machine's clock")
    if error.verify_code in WRONG_NAMES:
        return MeshFault(f"{setting}: the router's certificate does not name {host!r}", (
            f"`labanmesh secure renew SCENE ROUTER --host {host}`, or write a host that it names"
        ))  # fmt: skip
    if error.verify_code not in FOREIGN:
        return MeshFault(f"{setting}: the router's certificate is not accepted ({error.verify_message})", (
            "make one with `labanmesh secure add SCENE NAME --router`"
        ))  # fmt: skip
    return MeshFault(f"{setting}: the router's certificate is from a foreign authority, not the one in {folder}", (
        "take both from one `labanmesh secure init`, or correct the address, where another router answers"
    ))  # fmt: skip


def _own_fault(setting: str, folder: Path, error: OSError) -> MeshFault:
    """The fault of our certificate, by the router's alert."""
    reason = error.reason if isinstance(error, ssl.SSLError) else None
    alert = (reason or str(error)).lower().replace("_", " ")
    name = read_certificate(folder / CERTIFICATE_FILE).common_name
    if "expired" in alert:
        return MeshFault(f"{setting}: the router says that certificate {name} has expired", "set both machines' clocks")
    if "unknown ca" in alert:
        return MeshFault(f"{setting}: the router does not know the authority that signed {name}", (
            "take both from one `labanmesh secure init`"
        ))  # fmt: skip
    return MeshFault(f"{setting}: the router refused certificate {name} ({alert})", (
        "make new credentials for this machine with `labanmesh secure add`"
    ))  # fmt: skip
