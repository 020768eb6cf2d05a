"""Prints verdicts: python subscriber.py tcp/127.0.0.1:7447. Needs eclipse-zenoh and msgpack, nothing of labanmesh."""

import json
import sys

import msgpack
import zenoh

mode = sys.argv[2] if len(sys.argv) > 2 else "peer"  # client, where the scene's mesh.mode is router
meeting = {"connect": {"endpoints": [sys.argv[1]]}, "listen": {"endpoints": {"peer": ["tcp/127.0.0.1:0"]}}}
config = zenoh.Config.from_json5(json.dumps({"mode": mode, **meeting, "scouting": {"multicast": {"enabled": False}}}))
queue = zenoh.handlers.FifoChannel(1000)
with zenoh.open(config) as session, session.declare_subscriber("laban/*/verdict", queue) as verdicts:
    for sample in verdicts:
        said = msgpack.unpackb(sample.payload.to_bytes())
        agree, stage = said["agreement"], "decided" if said["ended_ns"] is None else "ended"
        print(said["scene"], said["label"], f"{agree['k']} of {agree['n']} agree", stage, flush=True)
