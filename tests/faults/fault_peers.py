"""Peers of a scene, run as processes: a hub that writes what it receives, and an observer whose clock stands still.
python fault_peers.py witness SCENE.toml: each message as a line of JSON, {"kind", "arrived_ns", "message"}; the first
line shows that it listens. Of a folder of scene files all; of judgements in scenes after the first only some fields.
python fault_peers.py echo SCENE.toml OF ID: publishes as ID what the observer OF publishes, always with the same time.
python fault_peers.py film SCENE.toml KEY FILM.npz: the tracks of a film, again and again, as another program's tracks
under KEY. All end on SIGTERM."""

import itertools
import json
import secrets
import sys
import time
from pathlib import Path

from common.config import read_scene, scene_files
from common.lifecycle import stop_on_signals
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage, StatusMessage, VerdictMessage
from common.wire import decode, encode
from observer.motion.archive_file import read_archive

KINDS = {"judgement": JudgementMessage, "verdict": VerdictMessage, "status": StatusMessage}


def witness(keys, link, stop, *more):
    inbox = link.inbox(keys.judgement, keys.verdict, keys.observer_status(), keys.fusion_status())
    others = link.inbox(*(key for other in more for key in (other.judgement, other.verdict)), limit=20_000)
    print(json.dumps({"kind": "listening"}), flush=True)
    while not stop.is_set():
        for arrival in inbox.take(0.1):
            write(arrival)
        for arrival in others.take(0):
            write_in_short(arrival)


def write_in_short(arrival):
    """What an aftermath needs, and what shows why a verdict came about."""
    kind = arrival.key.rsplit("/", 1)[-1]
    message = decode(KINDS[kind], arrival.payload)
    names = ("scene", "at_ns", "fusion", "session", "id", "label", "stage", "began_ns", "decided_ns", "ended_ns")
    facts = {name: getattr(message, name) for name in (*names, "same_as", "why", "epoch") if hasattr(message, name)}
    facts["agreement"], facts["likeliest"] = vars(message.agreement), max(message.p)
    facts["movement"] = message.movement and {"id": message.movement.id}
    facts["votes"] = {name: vote_in_short(vote) for name, vote in message.votes.items()}
    print(json.dumps({"kind": kind, "arrived_ns": arrival.arrived_ns, "message": facts}), flush=True)


def vote_in_short(vote):
    fields = {name: getattr(vote, name) for name in ("state", "label", "age_s", "rest", "weight")}
    return {**fields, "likeliest": max(vote.p or (0.0,))}


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
            publisher.put(encode(message.with_fields(observer=own, **stamps)))
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
    scene, *others = (read_scene(path) for path in scene_files([Path(sys.argv[2])]))
    with stop_on_signals() as stop, Link.open(scene.mesh, role) as link:
        peer(scene.keys, link, stop, *(other.keys for other in others), *sys.argv[3:])
