"""A judge whose clock stands still: it says at once what another says, always dated alike. Run as a process.

python fault_echo.py SCENE.toml OF ME
"""

import secrets
import sys
import time
from pathlib import Path

from common.config import read_scene
from common.lifecycle import stop_on_signals
from common.link import Link
from common.messages import PosteriorMessage
from common.wire import decode, encode


def main(path, of, me):
    scene = read_scene(Path(path))
    stopped_ns, session, seq = time.time_ns(), secrets.token_hex(8), 0
    with stop_on_signals() as stop, Link.open(scene.mesh, "observer") as link:
        inbox, mouth = link.inbox(scene.keys.posterior(of)), link.publisher(scene.keys.posterior(me))
        link.announce(scene.keys.observer_alive(me))
        while not stop.is_set():
            for arrival in inbox.take(0.1):
                heard = decode(PosteriorMessage, arrival.payload)
                stamps = {"captured_ns": stopped_ns, "sent_ns": stopped_ns, "session": session, "seq": seq}
                mouth.put(encode(heard.model_copy(update={"observer": me, **stamps})))
                seq += 1


if __name__ == "__main__":
    main(*sys.argv[1:])
