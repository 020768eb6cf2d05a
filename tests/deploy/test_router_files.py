"""The configurations for Zenoh's own router, read by Zenoh: a mesh meets over the plain one, nobody at the other."""

import json
import re
from pathlib import Path

import pytest
import zenoh

from common.config import MeshConfig
from common.link import Link
from common.zenoh_settings import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, LEASE_MS

ROUTERS = Path(__file__).parents[2] / "deploy" / "zenoh"
PLAIN, SECURED = ROUTERS / "router.json5", ROUTERS / "router-secured.json5"
CREDENTIALS = "/etc/labanmesh/credentials"
SOON_S = 5.0


def opened(file, endpoint):
    """A session with the settings of `file`, listening at `endpoint`."""
    config = zenoh.Config.from_file(str(file))
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    return zenoh.open(config)


def locator(session):
    (reply,) = session.get(f"@/{session.zid()}/router", timeout=SOON_S)
    return json.loads(reply.ok.payload.to_string())["locators"][0]


@pytest.mark.parametrize("file", [PLAIN, SECURED], ids=lambda file: file.stem)
def test_zenoh_reads_it_and_it_is_the_router_that_ours_is(file):
    config = zenoh.Config.from_file(str(file))
    read = {
        key: json.loads(config.get_json(key))
        for key in ("mode", "scouting/multicast/enabled", "transport/link/tx/lease", "adminspace", "listen/endpoints")
    }
    assert (read["mode"], read["scouting/multicast/enabled"]) == ("router", False)
    assert read["transport/link/tx/lease"] == LEASE_MS
    assert read["adminspace"] == {"enabled": True, "permissions": {"read": True, "write": False}}
    (endpoint,) = read["listen/endpoints"]
    assert endpoint == ("tcp" if file is PLAIN else "tls") + "/0.0.0.0:7447"
    # And it is one that a scene file may name.
    assert MeshConfig(mode="router", endpoint=endpoint).endpoint == endpoint


def test_a_mesh_meets_over_the_plain_router():
    with opened(PLAIN, "tcp/127.0.0.1:0") as router:
        mesh = MeshConfig(mode="router", endpoint=locator(router))
        with Link.open(mesh, "observer") as observer, Link.open(mesh, "hub") as hub:
            inbox = hub.inbox("laban/dojo/**")
            observer.announce("laban/dojo/observer/sofa/alive")
            assert hub.presence("laban/dojo/observer/*/alive").wait_for(1, SOON_S)
            mouth = observer.publisher("laban/dojo/observer/sofa/posterior")
            assert mouth.wait_for_subscriber(SOON_S)
            mouth.put(b"said")
            assert inbox.take(SOON_S)[0].payload == b"said"


def test_the_secured_router_names_the_files_that_secure_writes():
    tls = json.loads(zenoh.Config.from_file(str(SECURED)).get_json("transport/link/tls"))
    assert tls["root_ca_certificate"] == f"{CREDENTIALS}/{AUTHORITY_FILE}"
    assert tls["listen_certificate"] == f"{CREDENTIALS}/{CERTIFICATE_FILE}"
    assert tls["listen_private_key"] == f"{CREDENTIALS}/{KEY_FILE}"
    assert tls["enable_mtls"] is True and tls["close_link_on_expiration"] is True


def test_the_secured_router_opens_no_plain_text_port():
    with pytest.raises(zenoh.ZError, match="Unsupported protocol: tcp"):
        opened(SECURED, "tcp/127.0.0.1:0")


def test_the_secured_routers_rules_admit_nobody(tmp_path):
    # Its access rules on a plain-text link: even who gets past TLS is not heard.
    text = re.sub(r"protocols: .*", "", SECURED.read_text("utf-8"))
    file = tmp_path / "router.json5"
    file.write_text(text)
    with opened(file, "tcp/127.0.0.1:0") as router:
        # Its own question to itself is not subject to its rules.
        mesh = MeshConfig(mode="router", endpoint=locator(router))
        with Link.open(mesh, "observer") as observer, Link.open(mesh, "hub") as hub:
            hub.inbox("laban/dojo/**")
            assert not observer.publisher("laban/dojo/observer/sofa/posterior").wait_for_subscriber(0.3)
            assert hub.ask("@/*/router", 0.2) == {}


def test_without_its_certificates_the_secured_router_does_not_open():
    if Path(CREDENTIALS).exists():
        pytest.skip("this machine has credentials of its own")
    with pytest.raises(zenoh.ZError, match="TLS private key file: No such file"):
        opened(SECURED, "tls/127.0.0.1:0")
