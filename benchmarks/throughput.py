"""How many posteriors a second one fusion process takes from sixteen publishers who put as fast as they can.

Ours is `labanmesh fuse` with its own count of what arrived and of what it read: of a flood it reads the newest of each
observer, so both are told. Floor: bare Zenoh into a FIFO channel that one loop drains in batches, each message unpacked
by msgpack, and nothing else. The same publishers speak to both, by turns; all share this machine's cores.
"""

import multiprocessing
import os
import re
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from pathlib import Path
from statistics import median

from benchmarks.bare_zenoh import SOON_S, drained
from benchmarks.crowd.play import NAMES, Saying, belief
from benchmarks.crowd.trial import free_port
from benchmarks.timing import Row, row
from common.config import MeshConfig
from common.errors import LabanmeshError
from common.link import Link

PUBLISHERS = 16
FLOOD_S = 3.0
ROUNDS = 3
SCENE = "bench"


def rows(rounds: int = ROUNDS, flood_s: float = FLOOD_S) -> Iterator[Row]:
    """Arrived, and read, against the floor."""
    bare, arrived, read = [], [], []
    for _ in range(rounds):
        bare.append(floor(flood_s))
        taken, used = ours(flood_s)
        arrived.append(taken)
        read.append(used)
    name = f"posteriors a second from {PUBLISHERS} publishers"
    # Ratio as everywhere ours / floor: here more is better.
    yield row(f"{name}, taken", median(arrived), median(bare), "/s", rounds)
    yield row(f"{name}, of these read", median(read), median(bare), "/s", rounds)


def floor(flood_s: float) -> float:
    """Messages a second of the bare loop."""
    port = free_port()
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    receiver = spawn.Process(target=_drain, args=(port, flood_s, there), daemon=True)
    receiver.start()
    try:
        with flooding(port):
            if not here.poll(SOON_S + flood_s):
                raise LabanmeshError("the bare receiver of the benchmark heard nothing; is loopback TCP allowed here?")
            count: float = here.recv()
            return count
    finally:
        receiver.join(SOON_S)


def ours(flood_s: float) -> tuple[float, float]:
    """Posteriors a second that arrived at `labanmesh fuse`, and that it read."""
    port, metrics = free_port(), free_port()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        path = Path(folder) / "scene.toml"
        path.write_text(_scene(port, metrics))
        command = [str(Path(sys.executable).with_name("labanmesh")), "fuse", str(path)]
        quiet = {**os.environ, "LABANMESH_LOG": "error"}
        fusion = subprocess.Popen(command, env=quiet)  # noqa: S603 - our own command
        stack.callback(_end, fusion)
        with flooding(port):
            begin, begun_s = _first_count(metrics), time.monotonic()
            time.sleep(flood_s)
            end, took_s = _counted(metrics), time.monotonic() - begun_s
        return (end[0] - begin[0]) / took_s, (end[1] - begin[1]) / took_s


@contextmanager
def flooding(port: int) -> Iterator[None]:
    """PUBLISHERS processes that put as fast as they can, all heard when the context begins."""
    spawn = multiprocessing.get_context("spawn")
    stop, ready = spawn.Event(), spawn.Semaphore(0)
    crowd = [spawn.Process(target=_flood, args=(n, port, ready, stop), daemon=True) for n in range(PUBLISHERS)]
    for publisher in crowd:
        publisher.start()
    try:
        for _ in crowd:
            if not ready.acquire(timeout=60):
                raise LabanmeshError("the publishers of the benchmark were not heard within a minute")
        yield
    finally:
        stop.set()
        for publisher in crowd:
            publisher.join(SOON_S)


def _flood(number: int, port: int, ready: "multiprocessing.synchronize.Semaphore", stop: Event) -> None:
    mesh = MeshConfig(endpoint=f"tcp/127.0.0.1:{port}")
    observer = f"cam{number}"
    saying = Saying(SCENE, observer, *belief(NAMES.labels[number % NAMES.size], number % 4))
    with Link.open(mesh, "observer") as link:
        voice = link.publisher(f"laban/{SCENE}/observer/{observer}/posterior")
        voice.wait_for_subscriber(60)
        ready.release()
        seq, parent = 0, os.getppid()
        while not stop.is_set() and os.getppid() == parent:
            for _ in range(256):
                seq += 1
                voice.put(saying.at(seq, time.time_ns()))


def _drain(port: int, flood_s: float, pipe: Connection) -> None:
    drained(f"tcp/127.0.0.1:{port}", f"laban/{SCENE}/**", flood_s, PUBLISHERS, pipe.send)


def _scene(port: int, metrics: int) -> str:
    labels = ", ".join(f'"{label}"' for label in NAMES.labels)
    observers = "".join(f'[observers.cam{n}]\nsource = "bench"\n' for n in range(PUBLISHERS))
    return (
        f'scene = "{SCENE}"\nvocabulary = [{labels}]\nvocabulary_name = "{NAMES.name}"\n'
        f'[mesh]\nendpoint = "tcp/127.0.0.1:{port}"\n[metrics]\nlisten = "127.0.0.1:{metrics}"\n{observers}'
    )


def _first_count(port: int) -> tuple[float, float]:
    """The service listens to the mesh a moment before it answers over HTTP."""
    end_s = time.monotonic() + SOON_S
    while True:
        try:
            return _counted(port)
        except OSError:
            if time.monotonic() > end_s:
                raise LabanmeshError(f"labanmesh fuse does not answer on port {port}") from None
            time.sleep(0.05)


def _counted(port: int) -> tuple[float, float]:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=60) as answer:
        text = answer.read().decode()
    found = [
        re.search(rf"^labanmesh_{name}_total\S* (\S+)", text, re.M)
        for name in ("posteriors_received", "posteriors_read")
    ]
    arrived, read = (float(match[1]) if match else 0.0 for match in found)
    return arrived, read


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.terminate()
    try:
        process.wait(SOON_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
