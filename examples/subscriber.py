"""Prints verdicts: python subscriber.py tcp/127.0.0.1:7447. Needs eclipse-zenoh and msgpack, nothing of labanmesh."""

import contextlib
import json
import sys

import msgpack
import zenoh

endpoint, *mode = sys.argv[1:] or sys.exit("usage: subscriber.py ENDPOINT [client], e.g. tcp/127.0.0.1:7447")
# mode: "client" if the scene's mesh.mode is "router"
endpoints = {"connect": {"endpoints": [endpoint]}, "listen": {"endpoints": {"peer": ["tcp/127.0.0.1:0"]}}}
settings = {"mode": mode[0] if mode else "peer", **endpoints, "scouting": {"multicast": {"enabled": False}}}
queue = zenoh.handlers.FifoChannel(1000)
with contextlib.suppress(KeyboardInterrupt), zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
    subscriber = session.declare_subscriber("laban/*/verdict", queue)
    for sample in subscriber:
        verdict = msgpack.unpackb(sample.payload.to_bytes())
        agree, stage = verdict["agreement"], verdict["stage"]
        if stage == "revised":
            stage = f"revised, it was {verdict['revises']}"
        print(verdict["scene"], verdict["label"], f"{agree['k']} of {agree['n']} agree", stage, flush=True)
