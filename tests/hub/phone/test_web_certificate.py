"""The certificate of the phone's page, and what its authority may sign."""

import socket
import ssl
import threading
from datetime import UTC, datetime

import pytest

from common.certificate_authority import KeyPair, issue, make_authority
from common.errors import BadInput
from hub.phone.web_certificate_file import given_certificate, own_certificate

HOSTS = ("192.168.7.20", "localhost", "127.0.0.1", "sofa.local")


def greeting_fault(context, folder, host):
    """Why a client that trusts the authority does not accept the server; None if it does."""
    with socket.create_server(("127.0.0.1", 0)) as port:

        def serve():
            connection, _ = port.accept()
            try:
                context.wrap_socket(connection, server_side=True).close()
            except OSError:
                connection.close()

        thread = threading.Thread(target=serve)
        thread.start()
        client = ssl.create_default_context(cafile=folder / "ca.pem")
        try:
            with socket.create_connection(port.getsockname()) as plain, client.wrap_socket(plain, server_hostname=host):
                return None
        except ssl.SSLError as error:
            return str(error)
        finally:
            thread.join()


@pytest.mark.parametrize("host", HOSTS)
def test_who_trusts_the_authority_trusts_the_page(tmp_path, host):
    assert greeting_fault(own_certificate(tmp_path / "a", HOSTS).context, tmp_path / "a", host) is None


def test_files_are_kept_private_and_used_again(tmp_path):
    first = own_certificate(tmp_path, HOSTS)
    kept = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert own_certificate(tmp_path, HOSTS[:2]).authority == first.authority
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == kept
    assert all(path.stat().st_mode & 0o077 == 0 for path in tmp_path.glob("*key.pem"))
    own_certificate(tmp_path, ("10.1.2.3",))
    assert (tmp_path / "certificate.pem").read_bytes() != kept["certificate.pem"]
    assert (tmp_path / "ca.pem").read_bytes() == kept["ca.pem"]
    assert len(first.fingerprint.split()) == 32


@pytest.mark.parametrize("host", ["example.com", "93.184.216.34"])
def test_the_authority_can_sign_for_nothing_on_the_internet(tmp_path, host):
    own_certificate(tmp_path, HOSTS)
    authority = KeyPair((tmp_path / "ca.pem").read_bytes(), (tmp_path / "ca-key.pem").read_bytes())
    stolen = issue(authority, "stolen", [host], datetime.now(UTC), server=True).pair
    (tmp_path / "stolen.pem").write_bytes(stolen.certificate + stolen.key)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(tmp_path / "stolen.pem")
    assert "subtree" in greeting_fault(context, tmp_path, host)


def test_a_certificate_of_secure_is_used_if_it_is_for_a_server(tmp_path):
    authority = make_authority("dojo", datetime.now(UTC))
    for folder, roles in (("router", ["router"]), ("hub", ["hub"])):
        (tmp_path / folder).mkdir()
        pair = issue(authority, folder, HOSTS, datetime.now(UTC), roles=roles).pair
        (tmp_path / folder / "ca.pem").write_bytes(authority.certificate)
        (tmp_path / folder / "certificate.pem").write_bytes(pair.certificate)
        (tmp_path / folder / "key.pem").write_bytes(pair.key)
        (tmp_path / folder / "key.pem").chmod(0o600)
    assert greeting_fault(given_certificate(tmp_path / "router").context, tmp_path / "router", "127.0.0.1") is None
    with pytest.raises(BadInput, match="not for a server; labanmesh secure add"):
        given_certificate(tmp_path / "hub")
    with pytest.raises(BadInput, match="no such folder"):
        given_certificate(tmp_path / "nowhere")
