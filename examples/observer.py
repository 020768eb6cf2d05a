"""An observer of your own, which listens instead of watching: python observer.py tcp/127.0.0.1:7447 < levels

It stands in for an audio classifier: each line of the standard input is a loudness in dB, and a person louder than
-30 dB moves. That a lunge comes with a shout of -5 dB and waving with -20 dB is made up. Replace it with a classifier,
a wristband, a radar, a glove: anything that knows how likely its observation is under each movement.
"""

import contextlib
import hashlib
import json
import math
import secrets
import sys
import time

import msgpack
import zenoh

SCENE, ID, LABELS = "dojo", "ear", ["lunging", "byebye"]
SHOUTS_DB, SPREAD_DB, SILENCE_DB = [-5.0, -20.0], 15.0, -30.0
HASH = hashlib.sha256("".join(f"{label}\n" for label in LABELS).encode()).hexdigest()[:16]
endpoint, *mode = sys.argv[1:] or sys.exit("usage: observer.py ENDPOINT [client], e.g. tcp/127.0.0.1:7447 < levels")
# mode: "client" if the scene's mesh.mode is "router"
endpoints = {"connect": {"endpoints": [endpoint]}, "listen": {"endpoints": {"peer": ["tcp/127.0.0.1:0"]}}}
settings = {"mode": mode[0] if mode else "peer", **endpoints, "scouting": {"multicast": {"enabled": False}}}
evidence = [0.0, 0.0]
with contextlib.suppress(KeyboardInterrupt), zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
    alive = session.liveliness().declare_token(f"laban/{SCENE}/observer/{ID}/alive")
    publisher = session.declare_publisher(f"laban/{SCENE}/observer/{ID}/posterior", encoding="application/msgpack")
    fixed = {"v": 1, "scene": SCENE, "observer": ID, "session": secrets.token_hex(8)}
    for seq, line in enumerate(sys.stdin):
        captured_ns, level = time.time_ns(), float(line)
        # Bayes' rule over everything since the last silence, in logarithms.
        fits = [-(((level - shout) / SPREAD_DB) ** 2) / 2 for shout in SHOUTS_DB]
        evidence = [0.0, 0.0] if level < SILENCE_DB else [e + fit for e, fit in zip(evidence, fits, strict=True)]
        odds = [math.exp(e - max(evidence)) for e in evidence]
        posterior = {"p": [o / sum(odds) for o in odds], "rest": 0.95 if level < SILENCE_DB else 0.05}
        times = {"seq": seq, "frames": seq + 1, "captured_ns": captured_ns, "sent_ns": time.time_ns()}
        publisher.put(msgpack.packb({**fixed, **times, **posterior, "vocabulary": {"name": "by ear", "hash": HASH}}))
