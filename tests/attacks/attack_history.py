"""The history of one run of an attack: each event as a line of JSON, chained by hashes, kept with the run's seed.
python tests/attacks/attack_history.py FILE: whether the file is whole, and how to run the attack again."""

import gzip
import hashlib
import json
import os
import sys
import time
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "build" / "attacks"
SEED = "LABANMESH_ATTACKS_SEED"


def storms():
    """The settings of storms in the environment, with which a run is repeated."""
    return {name: value for name, value in os.environ.items() if name.startswith("LABANMESH_STORM")}


class History:
    """Events of one run; `keep` writes them to build/attacks/<test>-<seed>.jsonl. A line's `chain` covers all before.
    test: its node id, which runs it again."""

    def __init__(self, test, seed, folder=FOLDER):
        self.seed, self._began_ns, self._lines, self._chain = seed, time.time_ns(), [], ""
        name = "".join(each if each.isalnum() else "-" for each in test.rpartition("::")[2]).strip("-")
        self.path = folder / f"{name}-{seed}.jsonl"
        self.note("begin", test=test, seed=seed, settings=storms())

    def note(self, event, **fields):
        """Record one event."""
        seconds = round((time.time_ns() - self._began_ns) / 1e9, 4)
        line = {"n": len(self._lines), "s": seconds, "event": event, **fields}
        self._chain = chained(self._chain, line)
        self._lines.append(json.dumps({**line, "chain": self._chain}, default=str))

    def keep_more(self, what, text):
        """Write something long beside the history, for whoever looks into a failure; returns its path."""
        path = self.path.with_suffix(f".{what}.gz")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(gzip.compress(text.encode()))
        return path

    def keep(self):
        """Write the file; returns its path."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.write_text("\n".join(self._lines) + "\n")
        return self.path


def chained(chain, line):
    """The hash of `line` and of all lines before it."""
    text = json.dumps(line, sort_keys=True, default=str)
    return hashlib.sha256((chain + text).encode()).hexdigest()[:16]


def checked(path):
    """The events of a history; raises ValueError that names the first line that was changed."""
    chain, events = "", []
    for number, text in enumerate(Path(path).read_text().splitlines(), 1):
        line = json.loads(text)
        kept = line.pop("chain")
        chain = chained(chain, line)
        if chain != kept:
            raise ValueError(f"{path}: line {number} is not as it was written")
        events.append(line)
    return events


if __name__ == "__main__":
    first, *_, last = checked(sys.argv[1])
    settings = "".join(f"{name}={value} " for name, value in first.get("settings", {}).items())
    again = f"{settings}{SEED}={first['seed']} LABANMESH_ATTACKS=long pytest -n0 {first['test']!r}"
    print(f"whole: {last['n'] + 1} events. Again: {again}")
