"""How long commands take to start: `labanmesh fuse` and `watch` until they are ready, and `--help`.

Ready is what they report to a supervisor (`READY=1`): fuse listens then, and has made sure that no other process has
its id; watch is connected. A first start, which may write bytecode, does not count. Floors: a bare interpreter that
opens a Zenoh session and has loaded the same libraries; for `--help` a bare interpreter.
"""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median

from benchmarks.bare_zenoh import TIMEOUT_S
from benchmarks.timing import BenchmarkRow, free_port, row
from common.errors import LabanmeshError

STARTS = 5
GOAL_S, HELP_GOAL_S = 0.5, 0.2
LABANMESH = str(Path(sys.executable).with_name("labanmesh"))
BARE = (
    "import msgpack, msgspec, numpy, pydantic, typer, zenoh; config = zenoh.Config();"
    "config.insert_json5('scouting/multicast/enabled', 'false'); zenoh.open(config); import os; os._exit(0)"
)
SCENE = """scene = "start"
vocabulary = ["wave", "clap"]
[mesh]
endpoint = "tcp/127.0.0.1:{port}"
[observers.cam1]
source = "bench"
"""


def rows(starts: int = STARTS) -> Iterator[BenchmarkRow]:
    """Median seconds of `starts` starts each."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    bare_s = _typical(partial(_to_end, [sys.executable, "-c", BARE], environment), starts)
    with tempfile.TemporaryDirectory() as place:
        scene = Path(place, "start.toml")
        scene.write_text(SCENE.format(port=free_port()))
        for verb in ("fuse", "watch"):
            ready_s = _typical(partial(_to_ready, [LABANMESH, verb, str(scene)], environment, place), starts)
            yield row(f"start of labanmesh {verb} to ready", ready_s, bare_s, "s", starts, GOAL_S)
    help_s = _typical(lambda: _to_end([LABANMESH, "--help"], environment), starts)
    empty_s = _typical(lambda: _to_end([sys.executable, "-c", "pass"], environment), starts)
    yield row("labanmesh --help", help_s, empty_s, "s", starts, HELP_GOAL_S)


def _typical(start: Callable[[], float], starts: int) -> float:
    start()
    return median(start() for _ in range(starts))


def _to_end(command: Sequence[str], environment: Mapping[str, str]) -> float:
    begun_s = time.monotonic()
    status = subprocess.run(command, env=dict(environment), capture_output=True, timeout=TIMEOUT_S).returncode  # noqa: S603
    if status:
        raise LabanmeshError(f"{' '.join(command)[:60]} ended with status {status}")
    return time.monotonic() - begun_s


def _to_ready(command: Sequence[str], environment: Mapping[str, str], folder: str) -> float:
    address = str(Path(folder, "ready"))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ready:
        ready.bind(address)
        ready.settimeout(TIMEOUT_S)
        begun_s = time.monotonic()
        process = subprocess.Popen(  # noqa: S603 - our own command
            command, env={**environment, "NOTIFY_SOCKET": address, "LABANMESH_LOG": "error"},
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            while b"READY=1" not in ready.recv(4096):
                continue
            return time.monotonic() - begun_s
        except TimeoutError:
            raise LabanmeshError(f"labanmesh {command[1]} was not ready within {TIMEOUT_S:g} s") from None
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(TIMEOUT_S)
            Path(address).unlink()
