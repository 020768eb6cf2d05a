"""A robot that reacts before the movement ends: python robot.py tcp/127.0.0.1:7447 0.9

It acts as soon as the fused probability of a movement passes its own threshold (here 0.9), which may be long before the
verdict; if the verdict differs, it takes the action back. Needs eclipse-zenoh and msgpack.

The threshold trades speed against errors: a lamp may be hasty, an arm should wait for the verdict.
"""

import argparse
import json
from contextlib import suppress
from dataclasses import dataclass, field

import msgpack
import zenoh

REACTIONS = {"byebye": "wave back", "lunging": "step aside", "nthrow": "duck"}


@dataclass
class Robot:
    """acting: the label that it reacts to, by the id of the movement; movements that have ended are removed."""

    threshold: float
    acting: dict[str, str] = field(default_factory=dict)

    def handle_judgement(self, judgement: dict) -> None:
        """React to the fused probability, once a movement."""
        movement, label = judgement.get("movement"), judgement["label"]
        # "Something else" is one of the answers. A label is empty while no observer contributes.
        p = max(judgement["p"]) * (1 - (judgement.get("unlearned") or 0))
        # The judgement and its verdict have the same id, which tells that they are about one movement.
        if movement and movement["id"] not in self.acting and label in REACTIONS and p >= self.threshold:
            self.acting[movement["id"]] = label
            after_s = (judgement["at_ns"] - movement["began_ns"]) / 1e9
            self.do(f"{REACTIONS[label]} ({label} {p:.0%}, {after_s:.1f} s after it began)")

    def handle_verdict(self, verdict: dict) -> None:
        """Correct the reaction: a verdict is decided, seldom revised, and ended, each under the same id."""
        before, label = self.acting.get(verdict["id"]), verdict["label"]
        if before != label:
            if before:
                self.do(f"stop: {REACTIONS[before]} (it was {label}, not {before})")
            self.acting[verdict["id"]] = label if label in REACTIONS else ""
            if label in REACTIONS:
                self.do(f"{REACTIONS[label]} ({label} by verdict)")
        if verdict["ended_ns"] is not None:
            self.acting.pop(verdict["id"], None)

    def do(self, action: str) -> None:
        """Replace this with the motors."""
        print(action, flush=True)


def main(endpoint: str, threshold: float, mode: str = "peer") -> None:
    """Listen for ever. mode: "client" if the scene's mesh.mode is "router"."""
    addresses = {"connect": {"endpoints": [endpoint]}, "listen": {"endpoints": {"peer": ["tcp/127.0.0.1:0"]}}}
    settings = {"mode": mode, **addresses, "scouting": {"multicast": {"enabled": False}}}
    robot = Robot(threshold)
    # One queue for both: a verdict precedes the judgement that it comes from, and stays before it.
    queue = zenoh.handlers.FifoChannel(1000)
    with (
        zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session,
        session.declare_subscriber("laban/*/*", queue) as samples,
    ):
        for sample in samples:
            message = msgpack.unpackb(sample.payload.to_bytes())
            if str(sample.key_expr).endswith("/judgement"):
                robot.handle_judgement(message)
            elif str(sample.key_expr).endswith("/verdict"):
                robot.handle_verdict(message)


if __name__ == "__main__":
    usage = "python robot.py ENDPOINT THRESHOLD [client], e.g. python robot.py tcp/127.0.0.1:7447 0.9"
    parser = argparse.ArgumentParser(usage=usage)
    parser.add_argument("endpoint")
    parser.add_argument("threshold", type=float)
    parser.add_argument("mode", nargs="?", choices=("peer", "client"), default="peer")
    with suppress(KeyboardInterrupt):
        main(**vars(parser.parse_args()))
