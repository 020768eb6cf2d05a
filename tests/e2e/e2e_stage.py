"""What end-to-end tests share: our command line as processes, scene files, and messages from the mesh."""

import json
import socket
import subprocess
import threading
from contextlib import contextmanager

from processes import SOON_S, labanmesh

from common.wire import decode

MOVEMENTS = ("lunging", "byebye", "nthrow", "stretch")
PERFORMED = ("byebye", "nthrow")
VIEWS = {"door": "door", "corner": "yaw:45", "wheel": "wheel"}


def run(folder, *words, timeout_s=SOON_S):
    """Run a command of ours in `folder` to its end."""
    return subprocess.run(labanmesh(*words), cwd=folder, capture_output=True, text=True, timeout=timeout_s)


@contextmanager
def started(folder, command):
    """A process in `folder` whose pipes are open; it is killed at the end of the block, or when it hangs."""
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, cwd=folder, text=True, **pipes) as process:
        watchdog = threading.Timer(SOON_S, process.kill)
        watchdog.start()
        try:
            yield process
        finally:
            watchdog.cancel()
            process.kill()


def free_endpoint():
    """An address of this machine that was free a moment ago."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"tcp/127.0.0.1:{server.getsockname()[1]}"


def write_scene(path, endpoint, observers, mesh=""):
    """A scene file; observers: for each name the lines of its section. mesh: more lines of [mesh]."""
    text = f'scene = "dojo"\n[mesh]\nendpoint = "{endpoint}"\n{mesh}'
    path.write_text(text + "".join(f"[observers.{name}]\n{lines}" for name, lines in observers.items()))
    return path


def played(*names, more="", motion="motion.npz"):
    """The sections of observers that see recorded motion; more: further lines of each."""
    return {name: f'source = "{motion}"\nview = "{VIEWS[name]}"\n{more}' for name in names or VIEWS}


def findings_in(report):
    """The findings of a report of the doctor (JSON), as (mark, what, to do)."""
    return [(each["mark"], each["what"], each["to_do"]) for each in json.loads(report)["findings"]]


def marks(findings, words):
    """The marks of all findings that hold `words`."""
    return {mark for mark, what, to_do in findings if words in f"{what} -> {to_do}"}


def messages(inbox, kind, count):
    """The first `count` messages, or more; none may be later than SOON_S after the one before."""
    received = []
    while len(received) < count:
        arrivals = inbox.take(SOON_S)
        assert arrivals, f"only {len(received)} of {count} messages"
        received += [decode(kind, arrival.payload) for arrival in arrivals]
    return received
