"""Prints verdicts: python subscriber.py tcp/127.0.0.1:7447. Needs eclipse-zenoh and msgpack, nothing of labanmesh."""

import json
import sys

import msgpack
import zenoh

mode = sys.argv[2] if len(sys.argv) > 2 else "peer"  # "client" if the scene's mesh.mode is "router"
settings = {"connect": {"endpoints": [sys.argv[1]]}, "listen": {"endpoints": {"peer": ["tcp/127.0.0.1:0"]}}}
config = zenoh.Config.from_json5(json.dumps({"mode": mode, **settings, "scouting": {"multicast": {"enabled": False}}}))
queue = zenoh.handlers.FifoChannel(1000)
with zenoh.open(config) as session, session.declare_subscriber("laban/*/verdict", queue) as samples:
    for sample in samples:
        verdict = msgpack.unpackb(sample.payload.to_bytes())
        agree, stage = verdict["agreement"], verdict["stage"]
        if stage == "revised":
            stage = f"revised, it was {verdict['revises']}"
        print(verdict["scene"], verdict["label"], f"{agree['k']} of {agree['n']} agree", stage, flush=True)
