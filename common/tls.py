"""Why an endpoint cannot be used: a look at it with plain sockets and TLS, because Zenoh says the same of every cause.

1. First what this machine has, then whether anybody listens, then what the two say of each other's certificates.
2. With TLS 1.3 a server judges our certificate only after our side is done: so we listen a moment for its complaint.
"""

import re
import socket
import ssl
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from common.credentials import MeshFault, check_credentials, read_certificate
from common.zenoh_settings import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE

if TYPE_CHECKING:
    from common.config import MeshConfig

TIMEOUT_S = 2.0
COMPLAINT_S = 0.5
"""How long a server may take to say that it does not like our certificate: a round trip, and some for a slow one."""
ADDRESS = re.compile(r"(?P<protocol>\w+)/(?:\[(?P<six>[^\]]+)\]|(?P<host>[^/\[\]]+)):(?P<port>\d+)([#?].*)?\Z")
GREETING_S = 1.0
"""How long a TLS server may take to answer a greeting: Zenoh's pauses for 0.1 s after each that failed."""
EXPIRED, NOT_YET, WRONG_NAMES, FOREIGN = 10, 9, (62, 64), (7, 18, 19, 20, 21)
"""OpenSSL's verification results (X509_V_ERR_...)."""
START = "start it with `labanmesh router` or correct the address"
CERTIFY = "let `labanmesh secure add SCENE NAME` make credentials for this machine, and name the folder"


def endpoint_fault(mesh: "MeshConfig", now: datetime, timeout_s: float = TIMEOUT_S) -> MeshFault | None:
    """Why this machine cannot meet the others at `mesh.endpoint`; None: nothing is wrong up to TLS.

    now: with its time zone. Each step on the network waits `timeout_s` at most. Of quic, udp and ws endpoints only the
    files are looked at.
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
                return _met_in_the_open(mesh.endpoint, plain, min(timeout_s, GREETING_S))
            if not mesh.credentials:
                return MeshFault(f"mesh.endpoint = {mesh.endpoint!r} needs mesh.credentials, which is empty", CERTIFY)
            return _met_in_private(mesh.endpoint, plain, host, folder)
    except OSError as error:
        return _not_reached(mesh.endpoint, error)


def _not_reached(endpoint: str, error: OSError) -> MeshFault:
    named = f"mesh.endpoint = {endpoint!r}"
    if isinstance(error, ConnectionRefusedError):
        return MeshFault(f"{named}: no router answers there", START)
    if isinstance(error, socket.gaierror):
        return MeshFault(f"{named}: this name is not known here", "correct it, or write the address as a number")
    if isinstance(error, TimeoutError):
        return MeshFault(
            f"{named}: no answer", "correct the address; is the machine on, does a firewall let us through?"
        )
    said = (error.strerror or str(error)).lower()
    return MeshFault(f"{named}: cannot be reached: {said}", "is this machine on the network?")


def _met_in_the_open(endpoint: str, plain: socket.socket, timeout_s: float) -> MeshFault | None:
    """We would speak in the clear: does the other side want TLS? It then answers a TLS greeting, else it does not."""
    curious = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    curious.check_hostname, curious.verify_mode = False, ssl.CERT_NONE
    plain.settimeout(timeout_s)
    try:
        curious.wrap_socket(plain).close()
    except ssl.SSLError as error:
        if not _is_complaint(error):
            return None
    except OSError:
        return None
    return MeshFault(f"mesh.endpoint = {endpoint!r}: the router there speaks TLS alone, and this is plain tcp", (
        'write tls/HOST:PORT and mesh.credentials in the scene file, see `labanmesh secure --help`'
    ))  # fmt: skip


def _met_in_private(endpoint: str, plain: socket.socket, host: str, folder: Path) -> MeshFault | None:
    """We would speak TLS: what do the two sides think of each other?"""
    named = f"mesh.endpoint = {endpoint!r}"
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(folder / AUTHORITY_FILE)
    context.load_cert_chain(folder / CERTIFICATE_FILE, folder / KEY_FILE)
    try:
        private = context.wrap_socket(plain, server_hostname=host)
    except ssl.SSLCertVerificationError as error:
        return _theirs(named, host, folder, error)
    except OSError as error:
        return _ours(named, folder, error) if _is_complaint(error) else _no_tls(named)
    with private:
        private.settimeout(COMPLAINT_S)
        try:
            private.recv(1)
        except TimeoutError:
            return None  # no complaint: the router waits for us to begin
        except OSError as error:
            return _ours(named, folder, error)
    return _ours(named, folder, OSError("closed without a word"))


def _is_complaint(error: OSError) -> bool:
    """Whether the other side said in TLS what it does not like; everything else is no TLS at all."""
    return isinstance(error, ssl.SSLError) and "ALERT" in (error.reason or "")


def _no_tls(named: str) -> MeshFault:
    return MeshFault(
        f"{named}: what listens there speaks no TLS",
        "start the router secured (`labanmesh router --scene SCENE`), or is it another program's port?",
    )


def _theirs(named: str, host: str, folder: Path, error: ssl.SSLCertVerificationError) -> MeshFault:
    """What we do not like in the router's certificate."""
    if error.verify_code == EXPIRED:
        return MeshFault(f"{named}: the router's certificate has expired", (
            "renew it with `labanmesh secure renew`, copy it to the router; or is this machine's clock wrong?"
        ))  # fmt: skip
    if error.verify_code == NOT_YET:
        return MeshFault(f"{named}: the router's certificate is not valid yet", "set this machine's clock")
    if error.verify_code in WRONG_NAMES:
        return MeshFault(f"{named}: the router's certificate does not name {host!r}", (
            f"`labanmesh secure renew SCENE ROUTER --host {host}`, or write a host that it names"
        ))  # fmt: skip
    if error.verify_code not in FOREIGN:
        return MeshFault(f"{named}: the router's certificate is not accepted ({error.verify_message})", (
            "make one with `labanmesh secure add SCENE NAME --router`"
        ))  # fmt: skip
    return MeshFault(f"{named}: the router's certificate is from a foreign authority, not the one in {folder}", (
        "both must come from one `labanmesh secure init`; or somebody else answers at that address"
    ))  # fmt: skip


def _ours(named: str, folder: Path, error: OSError) -> MeshFault:
    """What the router does not like in ours."""
    reason = error.reason if isinstance(error, ssl.SSLError) else None
    said = (reason or str(error)).lower().replace("_", " ")
    name = read_certificate(folder / CERTIFICATE_FILE).common_name
    if "expired" in said:
        return MeshFault(f"{named}: the router says that certificate {name} has expired", "set both machines' clocks")
    if "unknown ca" in said:
        return MeshFault(f"{named}: the router does not know the authority that signed {name}", (
            "both must come from one `labanmesh secure init`"
        ))  # fmt: skip
    return MeshFault(f"{named}: the router refused certificate {name} ({said})", (
        "let `labanmesh secure add` make new credentials for this machine"
    ))  # fmt: skip
