"""A hub that writes down, as lines of JSON, all that is judged, decided and told in a scene. Run as a process.

python fault_witness.py SCENE.toml: one line a message, {"kind", "arrived_ns", "said"}; the first line says that it
listens. Ends on SIGTERM.
"""

import json
import sys
from pathlib import Path

from common.config import read_scene
from common.lifecycle import stop_on_signals
from common.link import Link
from common.messages import JudgementMessage, StatusMessage, VerdictMessage
from common.wire import decode

KINDS = {"judgement": JudgementMessage, "verdict": VerdictMessage, "status": StatusMessage}


def main(path):
    scene = read_scene(Path(path))
    keys = scene.keys
    with stop_on_signals() as stop, Link.open(scene.mesh, "hub") as link:
        inbox = link.inbox(keys.judgement, keys.verdict, keys.observer_status(), keys.fusion_status())
        print(json.dumps({"kind": "listening"}), flush=True)
        while not stop.is_set():
            for arrival in inbox.take(0.1):
                write(arrival)


def write(arrival):
    kind = arrival.key.rsplit("/", 1)[-1]
    said = json.loads(decode(KINDS[kind], arrival.payload).model_dump_json())
    for name in ("p", "vocabulary"):
        said.pop(name, None)
    for vote in said.get("votes", {}).values():
        vote.pop("p", None)
    print(json.dumps({"kind": kind, "arrived_ns": arrival.arrived_ns, "said": said}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
