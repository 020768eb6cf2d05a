"""What a Zenoh router with our settings does with a message that is far too large."""

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
from common.zenoh_settings import nested, settings

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
def test_a_huge_message_does_not_fill_a_router_and_its_sender_can_go_on():
    huge = 100 << 20
    command = [sys.executable, "-P", "-c", ROUTER, OURS]
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
