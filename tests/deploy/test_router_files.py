"""The configurations for Zenoh's own router, read by Zenoh: a mesh meets at the plain one; the other admits nobody."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
import zenoh
from processes import SOON_S

from common.config import MeshConfig
from common.link import Link
from common.zenoh_settings import LEASE_MS, MAX_MESSAGE_BYTES, NEVER_BLOCKING, nested, settings

ROUTERS = Path(__file__).parents[2] / "deploy" / "zenoh"
PLAIN, SECURED = ROUTERS / "router.json5", ROUTERS / "router-secured.json5"
CREDENTIALS = "/etc/labanmesh/credentials"


def opened(file, endpoint):
    """A session with the settings of `file`, listening at `endpoint`."""
    config = zenoh.Config.from_file(str(file))
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    return zenoh.open(config)


def locator(session):
    (reply,) = session.get(f"@/{session.zid()}/router", timeout=SOON_S)
    return json.loads(reply.ok.payload.to_string())["locators"][0]


@pytest.mark.parametrize("file", [PLAIN, SECURED], ids=lambda file: file.stem)
def test_zenoh_reads_it_and_it_has_the_settings_of_ours(file):
    config = zenoh.Config.from_file(str(file))
    read = {
        key: json.loads(config.get_json(key))
        for key in (
            "mode",
            "scouting/multicast/enabled",
            "transport/link",
            "adminspace",
            "listen/endpoints",
            "qos/network",
        )
    }
    assert (read["mode"], read["scouting/multicast/enabled"]) == ("router", False)
    assert read["transport/link"]["tx"]["lease"] == LEASE_MS
    assert read["transport/link"]["rx"]["max_message_size"] == MAX_MESSAGE_BYTES
    (rule,) = read["qos/network"]
    rule["overwrite"] = {name: value for name, value in rule["overwrite"].items() if value is not None}
    assert {name: rule[name] for name in NEVER_BLOCKING} == NEVER_BLOCKING
    assert read["adminspace"] == {"enabled": True, "permissions": {"read": True, "write": False}}
    (endpoint,) = read["listen/endpoints"]
    assert endpoint == ("tcp/127.0.0.1:7447" if file is PLAIN else "tls/0.0.0.0:7447")
    # A scene file may name this endpoint.
    assert MeshConfig(mode="router", endpoint=endpoint).endpoint == endpoint


def test_a_mesh_meets_over_the_plain_router():
    with opened(PLAIN, "tcp/127.0.0.1:0") as router:
        mesh = MeshConfig(mode="router", endpoint=locator(router))
        with Link.open(mesh, "observer") as observer, Link.open(mesh, "hub") as hub:
            inbox = hub.inbox("laban/dojo/**")
            observer.announce("laban/dojo/observer/sofa/alive")
            assert hub.presence("laban/dojo/observer/*/alive").wait_for(1, SOON_S)
            publisher = observer.publisher("laban/dojo/observer/sofa/posterior")
            assert publisher.wait_for_subscriber(SOON_S)
            publisher.put(b"posterior")
            assert inbox.take(SOON_S)[0].payload == b"posterior"


OURS = json.dumps(nested(settings(MeshConfig(), "router", ["tcp/127.0.0.1:0"], 0.0)))
ROUTER = """
import sys
import zenoh

config = zenoh.Config.from_json5(sys.argv[1])
config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
with zenoh.open(config) as session:
    (reply,) = session.get(f"@/{session.zid()}/router")
    print(reply.ok.payload.to_string(), flush=True)
    sys.stdin.read()
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="its peak memory is read from /proc")
@pytest.mark.parametrize("text", [OURS, PLAIN.read_text("utf-8")], ids=["ours", "zenohd"])
def test_a_huge_message_does_not_fill_a_router_and_its_sender_can_go_on(text):
    huge = 100 << 20
    command = [sys.executable, "-P", "-c", ROUTER, text]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as router:
        mesh = MeshConfig(mode="router", endpoint=json.loads(router.stdout.readline())["locators"][0])
        with Link.open(mesh, "hub") as hub, Link.open(mesh, "observer") as observer:
            inbox, publisher = hub.inbox("a"), observer.publisher("a")
            assert publisher.wait_for_subscriber(SOON_S)
            # An attacker would block until all is sent; by default Zenoh drops fragments when its queue is full.
            observer._session.put("a", bytes(huge), congestion_control=zenoh.CongestionControl.BLOCK)
            publisher.put(b"small")
            assert [arrival.payload for arrival in inbox.take(SOON_S)] == [b"small"]
        peak_kb = int(re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{router.pid}/status").read_text())[1])
        router.stdin.close()
        assert router.wait(SOON_S) == 0
    assert peak_kb < huge / 1024


@pytest.mark.parametrize(
    ("endpoint", "fault"),
    [("tcp/127.0.0.1:0", "Unsupported protocol: tcp"), ("tls/127.0.0.1:0", "TLS private key file: No such file")],
)
def test_the_secured_router_opens_no_plain_text_port_and_none_without_its_certificates(endpoint, fault):
    if Path(CREDENTIALS).exists():
        pytest.skip("this machine has credentials of its own")
    with pytest.raises(zenoh.ZError, match=fault):
        opened(SECURED, endpoint)


def test_the_secured_routers_rules_admit_nobody(tmp_path):
    # Its access rules on a plain-text link: even a client that gets past TLS is not heard.
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
