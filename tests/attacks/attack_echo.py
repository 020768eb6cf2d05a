"""The observers of many scenes that see what those of the first scene see. Run as a process. python attack_echo.py
FOLDER: what the observers of the first scene of a folder publish, published in the others too."""

import sys
from pathlib import Path

from common.config import read_scene, scene_files
from common.keys import observer_of
from common.lifecycle import stop_on_signals
from common.link import Link
from common.messages import PosteriorMessage
from common.wire import BadMessage, decode, encode


def echo(scene, others, link, stop):
    """Until `stop` is set, each posterior of `scene` in the name of the same observer of each other scene."""
    inbox = link.inbox(scene.keys.posterior())
    publishers = {
        (other.scene, name): link.publisher(other.keys.posterior(name)) for other in others for name in scene.roster
    }
    for other in others:
        for name in scene.roster:
            link.announce(other.keys.observer_alive(name))
    print("echoes", flush=True)
    while not stop.is_set():
        for arrival in inbox.take(0.1):
            try:
                message = decode(PosteriorMessage, arrival.payload)
            except BadMessage:
                continue
            for other in others:
                payload = encode(message.with_fields(scene=other.scene))
                publishers[other.scene, observer_of(arrival.key)].put(payload)


if __name__ == "__main__":
    first, *rest = (read_scene(path) for path in scene_files([Path(sys.argv[1])]))
    with stop_on_signals() as stop, Link.open(first.mesh, "hub") as link:
        echo(first, rest, link, stop)
