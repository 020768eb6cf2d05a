"""The look at an endpoint without Zenoh: each cause has its own message, and a usable endpoint none."""

import json
import socket
import threading
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta

import pytest
from mesh_stage import lay_out

from common.certificate_authority import issue, make_authority
from common.config import MeshConfig
from common.link import Link
from common.tls import endpoint_fault
from common.zenoh_settings import nested, settings

NOW = datetime.now(UTC)
ROUTER, CAMERA = ("router",), ("observer:cam1",)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Makes a folder of credentials."""
    base = tmp_path_factory.mktemp("credentials")
    authorities = {name: make_authority(name, NOW) for name in ("ours", "theirs")}

    def made(name, roles=CAMERA, hosts=("127.0.0.1",), signed="ours", trusts="ours", days=1.0):
        if (base / name).exists():
            return str(base / name)
        pair = issue(authorities[signed], f"{name}.1", hosts, NOW, roles=roles, days=days).pair
        return lay_out(base / name, pair, authorities[trusts].certificate)

    return made


@contextmanager
def router(credentials, protocol="tls"):
    endpoint = f"{protocol}/127.0.0.1:0"
    mesh = MeshConfig(mode="router", endpoint=endpoint, credentials=credentials)
    with Link.router(json.dumps(nested(settings(mesh, "router", [endpoint], 0.0))), "the test's router") as link:
        yield link.locator


@contextmanager
def listener(answer):
    """A TCP port that calls `answer(connection)` for the one client that connects, then closes."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            connection, _ = server.accept()
            with connection:
                answer(connection)

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"tls/127.0.0.1:{server.getsockname()[1]}"
        thread.join()


def fault_of(endpoint, credentials, **more):
    mesh = MeshConfig(mode="router", endpoint=endpoint, credentials=credentials)
    return endpoint_fault(mesh, more.pop("now", NOW), **more)


@pytest.mark.parametrize(
    ("theirs", "cause", "way_out"),
    [
        ({"hosts": ("judge.example",)}, "does not name '127.0.0.1'", "--host 127.0.0.1"),
        ({"signed": "theirs"}, "from a foreign authority", "labanmesh secure init"),
        ({"days": -1.0}, "the router's certificate has expired", "labanmesh secure renew"),
        ({"roles": CAMERA}, "is not accepted (unsuitable certificate purpose)", "--router"),
    ],
)
def test_faults_of_the_routers_certificate(folder, theirs, cause, way_out):
    name = f"router-{next(iter(theirs))}"
    with router(folder(name, **{"roles": ROUTER, **theirs})) as endpoint:
        fault = fault_of(endpoint, folder("cam1"))
    assert cause in fault.what and way_out in fault.remedy and endpoint in fault.what


def test_a_certificate_that_is_expired_for_the_router_alone(folder):
    """A machine whose clock stands still: by its own clock the certificate is valid."""
    with router(folder("router", ROUTER)) as endpoint:
        fault = fault_of(endpoint, folder("late", days=-1.0), now=NOW - timedelta(days=1, minutes=30))
    assert "the router says that certificate late.1 has expired" in fault.what


def test_a_router_that_trusts_another_authority(folder):
    with router(folder("router-trusts", ROUTER, trusts="theirs")) as endpoint:
        fault = fault_of(endpoint, folder("cam1"))
    assert "the router does not know the authority that signed cam1.1" in fault.what


def test_nobody_listens_and_no_such_name(folder):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    assert "no router answers there" in fault_of(f"tls/127.0.0.1:{port}", folder("cam1")).what
    assert "this name is not known here" in fault_of("tls/no-such-host.invalid:1", folder("cam1")).what


def test_a_listener_without_tls(folder):
    enough = threading.Event()
    with listener(lambda connection: None) as endpoint:
        assert "speaks no TLS" in fault_of(endpoint, folder("cam1")).what
    with listener(lambda connection: connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")) as endpoint:
        assert "speaks no TLS" in fault_of(endpoint, folder("cam1")).what
    with listener(lambda connection: enough.wait()) as endpoint:
        assert "speaks no TLS" in fault_of(endpoint, folder("cam1"), timeout_s=0.2).what
        enough.set()
    with Link.open(MeshConfig(mode="router"), "router", listen=["tcp/127.0.0.1:0"]) as plain:
        assert "speaks no TLS" in fault_of(plain.locator.replace("tcp/", "tls/"), folder("cam1"), timeout_s=0.2).what


def test_an_endpoint_of_the_protocol_in_the_scene_file_has_no_fault_and_another_has(folder):
    with Link.open(MeshConfig(mode="router"), "router", listen=["tcp/127.0.0.1:0"]) as plain:
        assert fault_of(plain.locator, "", timeout_s=0.2) is None
    with router(folder("router", ROUTER)) as endpoint:
        assert fault_of(endpoint, folder("cam1")) is None
        assert "accepts TLS only" in endpoint_fault(MeshConfig(endpoint=endpoint.replace("tls/", "tcp/")), NOW).what
        assert "needs mesh.credentials" in endpoint_fault(MeshConfig(endpoint=endpoint), NOW).what


@pytest.mark.parametrize("endpoint", ["quic/127.0.0.1:1", "unixsock-stream//nowhere"])
def test_for_other_protocols_only_the_files_are_checked(folder, endpoint):
    assert endpoint_fault(MeshConfig(endpoint=endpoint), NOW) is None
