"""A robot that reacts before the movement ends: python robot.py tcp/127.0.0.1:7447 0.9

It acts as soon as the pooled belief in a movement passes its own threshold (here 0.9), which may be long before the
referee decides; when the verdict says otherwise it takes that back. Needs eclipse-zenoh and msgpack.

How early and how often wrong is a matter of the threshold: a lamp may be hasty, an arm should wait for the verdict.
"""

import json
import sys
from dataclasses import dataclass, field

import msgpack
import zenoh

REACTIONS = {"byebye": "wave back", "lunging": "step aside", "nthrow": "duck"}


@dataclass
class Robot:
    """What it does now, by the id of the movement that it does it for; movements that have ended are forgotten."""

    threshold: float
    acting: dict[str, str] = field(default_factory=dict)

    def heard_judgement(self, said: dict) -> None:
        """What the judges believe now: act on it, once a movement."""
        movement, label = said.get("movement"), said["label"]
        # "Something else" is an answer, too.
        sure = max(said["p"]) * (1 - (said.get("unlearned") or 0))
        # The judgement and its verdict bear the same id, so that one is known to be about the other.
        if movement and movement["id"] not in self.acting and label in REACTIONS and sure >= self.threshold:
            self.acting[movement["id"]] = label
            after_s = (said["at_ns"] - movement["began_ns"]) / 1e9
            self.do(f"{REACTIONS[label]} ({label} {sure:.0%}, {after_s:.1f} s after it began)")

    def heard_verdict(self, said: dict) -> None:
        """What was done, by the word of the referee: the first word when decided, the last when it has ended."""
        before, label = self.acting.get(said["id"]), said["label"]
        if before != label:
            if before:
                self.do(f"stop: {REACTIONS[before]} (it was {label}, not {before})")
            self.acting[said["id"]] = label if label in REACTIONS else ""
            if label in REACTIONS:
                self.do(f"{REACTIONS[label]} ({label} by verdict)")
        if said["ended_ns"] is not None:
            self.acting.pop(said["id"], None)

    def do(self, what: str) -> None:
        """Here the motors begin."""
        print(what, flush=True)


def main(endpoint: str, threshold: float, mode: str = "peer") -> None:
    """Listen for ever; mode: client, where the scene's mesh.mode is router."""
    meeting = {"connect": {"endpoints": [endpoint]}, "listen": {"endpoints": {"peer": ["tcp/127.0.0.1:0"]}}}
    settings = {"mode": mode, **meeting, "scouting": {"multicast": {"enabled": False}}}
    robot = Robot(threshold)
    # One queue for both: a verdict is said before the judgement that it comes from, and stays before it.
    queue = zenoh.handlers.FifoChannel(1000)
    with (
        zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session,
        session.declare_subscriber("laban/*/*", queue) as heard,
    ):
        for sample in heard:
            said = msgpack.unpackb(sample.payload.to_bytes())
            if str(sample.key_expr).endswith("/judgement"):
                robot.heard_judgement(said)
            elif str(sample.key_expr).endswith("/verdict"):
                robot.heard_verdict(said)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), *sys.argv[3:])
