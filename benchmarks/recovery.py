"""How long a scene is without a judgement: when its leading fusion service is killed, and when its router is.

Router and two fusion services are processes; in this one an observer speaks 60 times a second and a hub listens.
- failover: from the kill to the other service's first judgement. Floor: until Zenoh tells that the process is gone.
- reconnection: from the new router's listening to the first judgement. Floor: until bytes go through it again between
  two bare Zenoh clients that try as often.
Medians; each round is measured by turns with its floor, in the same moment.
"""

import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median

import zenoh

from benchmarks.posteriors import NAMES, beliefs, message
from benchmarks.timing import Row, row
from common.config import Scene, read_scene
from common.errors import LabanmeshError
from common.inbox import Inbox
from common.link import Link
from common.messages import JudgementMessage
from common.wire import decode, encode
from common.zenoh_settings import RETRY

ROUNDS = 7
RATE_HZ = 60.0
SOON_S = 15.0
SERVICES = ("first", "second")
BARE = "bench/bare/recovery"


def rows(rounds: int = ROUNDS) -> Iterator[Row]:
    """Failover and reconnection; raises LabanmeshError when the processes do not find each other."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as open_until_end:
        mesh = open_until_end.enter_context(Mesh(Path(folder)).up())
        yield _row("failover, leading fusion service killed", [mesh.failover() for _ in range(rounds)])
        yield _row("reconnection, router killed and back", [mesh.reconnection() for _ in range(rounds)])


def _row(name: str, measured: list[tuple[float, float]]) -> Row:
    ours, floor = (median(times) * 1000 for times in zip(*measured, strict=True))
    return row(name, ours, floor, "ms", len(measured))


class Mesh:
    """The processes, the observer and the hub of one scene in `folder`."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "scene.toml"
        self._router = _start("router", "tcp/127.0.0.1:0")
        self._endpoint = _said(self._router).split()[-1]
        labels = ", ".join(f'"{label}"' for label in NAMES.labels)
        self._file.write_text(
            f'scene = "bench"\nvocabulary = [{labels}]\nvocabulary_name = "{NAMES.name}"\n[mesh]\nmode = "router"\n'
            f'endpoint = "{self._endpoint}"\n[fusion]\nid = "first"\nstandby = ["second"]\n'
            '[observers.cam1]\nsource = "bench.npz"\n'
        )
        self._services = {name: self._fuse(name) for name in SERVICES}

    def _fuse(self, name: str) -> subprocess.Popen[str]:
        return _start("fuse", str(self._file), "--id", name)

    @contextmanager
    def up(self) -> Iterator["Mesh"]:
        """With observer, hub and bare clients; all processes have ended afterwards."""
        scene, ended = read_scene(self._file, {}), threading.Event()
        try:
            with Link.open(scene.mesh, "observer") as eyes, Link.open(scene.mesh, "hub") as hub:
                self._judged = hub.inbox(scene.keys.judgement)
                self._alive = hub.presence(scene.keys.fusion_alive())
                self._key: Callable[[str], str] = scene.keys.fusion_alive
                with _bare(self._endpoint) as self._came, _speaking(scene, eyes, ended):
                    yield self
        finally:
            ended.set()
            for process in (*self._services.values(), self._router):
                process.kill()
                process.wait(SOON_S)

    def failover(self) -> tuple[float, float]:
        """Seconds until the other service judges, and until Zenoh tells that the leader is gone."""
        _until(lambda: len(self._alive.alive) == len(SERVICES), "both fusion services are alive")
        leader = _next(self._judged).fusion
        killed_ns = time.time_ns()
        self._services[leader].kill()
        # Busy on purpose: this is the measurement.
        while self._key(leader) in self._alive.alive:
            time.sleep(0.0002)
        gone_ns = time.time_ns()
        taken_over_ns = _first(self._judged, lambda said: said.fusion != leader)
        self._services[leader].wait(SOON_S)
        self._services[leader] = self._fuse(leader)
        return (taken_over_ns - killed_ns) / 1e9, (gone_ns - killed_ns) / 1e9

    def reconnection(self) -> tuple[float, float]:
        """Seconds from the new router's listening until a judgement is heard, and until bare bytes go through."""
        _next(self._judged)
        self._router.kill()
        self._router.wait(SOON_S)
        self._judged.take(0.0)
        self._router = _start("router", self._endpoint)
        _said(self._router)
        listening_ns = time.time_ns()
        self._came.clear()
        judged_ns = _first(self._judged, lambda said: said.at_ns > listening_ns)
        _until(lambda: bool(self._came), "bare bytes come through the new router")
        return (judged_ns - listening_ns) / 1e9, max(self._came[0] - listening_ns, 1_000) / 1e9


def _start(*words: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-P", "-m", "labanmesh", *words]
    pipe = subprocess.PIPE if words[0] == "router" else subprocess.DEVNULL
    nowhere = subprocess.DEVNULL
    return subprocess.Popen(command, stdin=nowhere, stdout=nowhere, stderr=pipe, text=True)  # noqa: S603 - our own verbs


def _said(process: subprocess.Popen[str]) -> str:
    """The next line that a router writes: that it listens, and where."""
    line = process.stderr.readline() if process.stderr else ""
    if "listening" not in line:
        raise LabanmeshError(f"`labanmesh router` did not begin: {line.strip() or 'it ended'}")
    return line


@contextmanager
def _speaking(scene: Scene, link: Link, ended: threading.Event) -> Iterator[None]:
    """An observer of the scene, in a thread of its own."""

    def speak() -> None:
        mouth, p, seq = link.publisher(scene.keys.posterior("cam1")), beliefs(1)[0], 0
        while not ended.wait(1 / RATE_HZ):
            mouth.put(encode(message("cam1", seq, time.time_ns(), p)))
            seq += 1

    thread = threading.Thread(target=speak, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(SOON_S)


@contextmanager
def _bare(endpoint: str) -> Iterator[list[int]]:
    """Two bare clients, one of which puts as often as the observer; yields when its bytes came (ns)."""
    came: list[int] = []
    settings: dict[str, object] = {"mode": "client", "connect/endpoints": [endpoint], "connect/retry": RETRY}
    settings |= {"scouting/multicast/enabled": False}
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    ended = threading.Event()
    with zenoh.open(config) as here, zenoh.open(config) as there:
        mouth = here.declare_publisher(BARE)

        def put() -> None:
            while not ended.wait(1 / RATE_HZ):
                mouth.put(b"x")

        with there.declare_subscriber(BARE, lambda _: came.append(time.time_ns())):
            thread = threading.Thread(target=put, daemon=True)
            thread.start()
            try:
                yield came
            finally:
                ended.set()
                thread.join(SOON_S)


def _next(inbox: Inbox) -> JudgementMessage:
    """A judgement that was not made before now."""
    now_ns = time.time_ns()
    found: list[JudgementMessage] = []
    _first(inbox, lambda said: said.at_ns > now_ns, found)
    return found[0]


def _first(
    inbox: Inbox, wanted: Callable[[JudgementMessage], bool], found: list[JudgementMessage] | None = None
) -> int:
    """When the first judgement that is wanted arrived (ns)."""
    deadline = time.monotonic() + SOON_S
    while time.monotonic() < deadline:
        for arrival in inbox.take(0.1):
            said = decode(JudgementMessage, arrival.payload)
            if wanted(said):
                if found is not None:
                    found.append(said)
                return arrival.arrived_ns
    raise LabanmeshError(f"no judgement within {SOON_S:g} s; do `labanmesh router` and `labanmesh fuse` work here?")


def _until(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + SOON_S
    while not condition():
        if time.monotonic() > deadline:
            raise LabanmeshError(f"not within {SOON_S:g} s: {what}")
        time.sleep(0.002)
