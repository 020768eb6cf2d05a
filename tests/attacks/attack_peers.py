"""An attacker as a process of its own, so that its work does not slow the witness: a bare Zenoh session that floods.
python attack_peers.py ENDPOINT MODE KEY BYTES PER_S FOR_S drop|block"""

import json
import sys
import time

import zenoh

BATCH_S = 0.001


def opened(endpoint, mode):
    """A session that follows no rule of labanmesh."""
    config = zenoh.Config()
    values = {"mode": mode, "connect/endpoints": [endpoint], "listen/endpoints": [], "scouting/delay": 0}
    values |= {"scouting/multicast/enabled": False, "connect/exit_on_failure": False}
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def flood(session, key, size, per_s, for_s, congestion):
    """Messages of `size` bytes that nobody can read, at least one; returns how many were sent."""
    kind = zenoh.CongestionControl.BLOCK if congestion == "block" else zenoh.CongestionControl.DROP
    publisher = session.declare_publisher(key, congestion_control=kind)
    payload, sent, begun_s = zenoh.ZBytes(b"\xc1" * size), 0, time.monotonic()
    while sent == 0 or (passed_s := time.monotonic() - begun_s) < for_s:
        # A put that blocks may take long: what is due later is not sent after the end.
        while sent == 0 or (sent < per_s * passed_s and time.monotonic() - begun_s < for_s):
            publisher.put(payload)
            sent += 1
            passed_s = time.monotonic() - begun_s
        time.sleep(BATCH_S)
    return sent


if __name__ == "__main__":
    endpoint, mode, key, size, per_s, for_s, congestion = sys.argv[1:]
    with opened(endpoint, mode) as session:
        print(f"sent {flood(session, key, int(size), float(per_s), float(for_s), congestion)}", flush=True)
