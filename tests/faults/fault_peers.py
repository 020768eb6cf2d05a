"""Peers of a scene, run as processes: a hub that writes what it receives, and an observer whose clock stands still.

python fault_peers.py witness SCENE.toml: each message as a line of JSON, {"kind", "arrived_ns", "message"}; the first
line shows that it listens. python fault_peers.py echo SCENE.toml OF ID: publishes as ID what the observer OF publishes,
always with the same time. python fault_peers.py film SCENE.toml KEY FILM.npz: the tracks of a film, again and again, as
another program's tracks under KEY. All end on SIGTERM.
"""

import itertools
import json
import secrets
import sys
import time
from pathlib import Path

from common.config import read_scene
from common.lifecycle import stop_on_signals
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage, StatusMessage, VerdictMessage
from common.wire import decode, encode
from observer.motion.archive_file import read_archive

KINDS = {"judgement": JudgementMessage, "verdict": VerdictMessage, "status": StatusMessage}


def witness(keys, link, stop):
    inbox = link.inbox(keys.judgement, keys.verdict, keys.observer_status(), keys.fusion_status())
    print(json.dumps({"kind": "listening"}), flush=True)
    while not stop.is_set():
        for arrival in inbox.take(0.1):
            write(arrival)


def write(arrival):
    kind = arrival.key.rsplit("/", 1)[-1]
    message = json.loads(decode(KINDS[kind], arrival.payload).model_dump_json())
    for name in ("p", "vocabulary"):
        message.pop(name, None)
    for vote in message.get("votes", {}).values():
        vote.pop("p", None)
    print(json.dumps({"kind": kind, "arrived_ns": arrival.arrived_ns, "message": message}), flush=True)


def echo(keys, link, stop, of, own):
    stopped_ns, session, seq = time.time_ns(), secrets.token_hex(8), 0
    inbox, publisher = link.inbox(keys.posterior(of)), link.publisher(keys.posterior(own))
    link.announce(keys.observer_alive(own))
    while not stop.is_set():
        for arrival in inbox.take(0.1):
            stamps = {"captured_ns": stopped_ns, "sent_ns": stopped_ns, "session": session, "seq": seq}
            message = decode(PosteriorMessage, arrival.payload)
            publisher.put(encode(message.model_copy(update={"observer": own, **stamps})))
            seq += 1


def film(keys, link, stop, key, path):
    archive = read_archive(Path(path))
    (recording,), publisher = archive.recordings, link.publisher(key)
    for frame in itertools.cycle(recording.positions.tolist()):
        if stop.wait(1 / recording.rate_hz):
            return
        publisher.put(json.dumps({"parts": dict(zip(archive.body_parts, frame, strict=True))}).encode())


if __name__ == "__main__":
    peer, role = {"witness": (witness, "hub"), "echo": (echo, "observer"), "film": (film, "hub")}[sys.argv[1]]
    scene = read_scene(Path(sys.argv[2]))
    with stop_on_signals() as stop, Link.open(scene.mesh, role) as link:
        peer(scene.keys, link, stop, *sys.argv[3:])
