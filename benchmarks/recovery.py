"""How long a scene is without a judgement after its leading fusion service, or its router, is killed.

Router and two fusion services are processes; in this process an observer publishes at 60 Hz and a hub receives.
- failover: from the kill to the other service's first judgement. Floor: until Zenoh reports that the process is gone.
- reconnection: from the new router's listening to the first judgement. Floor: until bytes pass through it again between
  two bare Zenoh clients that retry as often.
Medians; each round measures the figure and its floor at the same moment.
"""

import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from benchmarks.bare_zenoh import open_bare
from benchmarks.posteriors import NAMES, message, random_posteriors
from benchmarks.timing import BenchmarkRow, row
from common import SECOND_NS
from common.config import Scene, read_scene
from common.errors import LabanmeshError
from common.inbox import Inbox
from common.link import Link
from common.messages import JudgementMessage
from common.wire import decode, encode
from common.zenoh_settings import RETRY

ROUNDS = 7
RATE_HZ = 60.0
TIMEOUT_S = 15.0
SERVICES = ("first", "second")
BARE = "bench/bare/recovery"


@dataclass(frozen=True, slots=True)
class RecoveryTime:
    """Seconds without a judgement, and the floor."""

    ours_s: float
    floor_s: float


@dataclass(frozen=True, slots=True)
class TimedJudgement:
    """A judgement and its arrival (Unix epoch, ns)."""

    judgement: JudgementMessage
    arrived_ns: int


def rows(rounds: int = ROUNDS) -> Iterator[BenchmarkRow]:
    """Failover and reconnection; raises LabanmeshError when the processes do not connect."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        mesh = stack.enter_context(RecoveryMesh(Path(folder)).up())
        yield _row("failover, leading fusion service killed", [mesh.failover() for _ in range(rounds)])
        yield _row("reconnection, router killed and back", [mesh.reconnection() for _ in range(rounds)])


def _row(name: str, outages: list[RecoveryTime]) -> BenchmarkRow:
    ours_ms, floor_ms = median(o.ours_s for o in outages) * 1e3, median(o.floor_s for o in outages) * 1e3
    return row(name, ours_ms, floor_ms, "ms", len(outages))


class RecoveryMesh:
    """The processes, the observer and the hub of one scene in `folder`."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "scene.toml"
        self._router = _start("router", "tcp/127.0.0.1:0")
        self._endpoint = _listening(self._router).split()[-1]
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
    def up(self) -> Iterator["RecoveryMesh"]:
        """With observer, hub and bare clients; all processes end with the context."""
        scene, ended = read_scene(self._file, {}), threading.Event()
        try:
            with Link.open(scene.mesh, "observer") as observer, Link.open(scene.mesh, "hub") as hub:
                self._judgements = hub.inbox(scene.keys.judgement)
                self._alive = hub.presence(scene.keys.fusion_alive())
                self._key: Callable[[str], str] = scene.keys.fusion_alive
                with _bare_clients(self._endpoint) as self._arrived_ns, _publishing(scene, observer, ended):
                    yield self
        finally:
            ended.set()
            for process in (*self._services.values(), self._router):
                process.kill()
                process.wait(TIMEOUT_S)

    def failover(self) -> RecoveryTime:
        """Until the other service judges; floor: until Zenoh reports that the leader is gone."""
        _wait_until(lambda: len(self._alive.alive) == len(SERVICES), "both fusion services are alive")
        leader = _next(self._judgements).judgement.fusion
        killed_ns = time.time_ns()
        self._services[leader].kill()
        # A busy loop, because its delay is part of the measurement.
        while self._key(leader) in self._alive.alive:
            time.sleep(0.0002)
        gone_ns = time.time_ns()
        taken_over = _first(self._judgements, lambda judgement: judgement.fusion != leader)
        self._services[leader].wait(TIMEOUT_S)
        self._services[leader] = self._fuse(leader)
        return RecoveryTime((taken_over.arrived_ns - killed_ns) / SECOND_NS, (gone_ns - killed_ns) / SECOND_NS)

    def reconnection(self) -> RecoveryTime:
        """From the new router's listening until a judgement arrives; floor: until bare bytes arrive."""
        _next(self._judgements)
        self._router.kill()
        self._router.wait(TIMEOUT_S)
        self._judgements.take(0.0)
        self._router = _start("router", self._endpoint)
        _listening(self._router)
        listening_ns = time.time_ns()
        self._arrived_ns.clear()
        judged = _first(self._judgements, lambda judgement: judgement.at_ns > listening_ns)
        _wait_until(lambda: bool(self._arrived_ns), "bare bytes pass through the new router")
        floor_ns = max(self._arrived_ns[0] - listening_ns, 1_000)
        return RecoveryTime((judged.arrived_ns - listening_ns) / SECOND_NS, floor_ns / SECOND_NS)


def _start(*words: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-P", "-m", "labanmesh", *words]
    pipe = subprocess.PIPE if words[0] == "router" else subprocess.DEVNULL
    nowhere = subprocess.DEVNULL
    return subprocess.Popen(command, stdin=nowhere, stdout=nowhere, stderr=pipe, text=True)  # noqa: S603 - our own verbs


def _listening(process: subprocess.Popen[str]) -> str:
    """The line in which a router reports where it listens."""
    line = process.stderr.readline() if process.stderr else ""
    if "listening" not in line:
        raise LabanmeshError(f"`labanmesh router` did not start: {line.strip() or 'it ended'}")
    return line


@contextmanager
def _publishing(scene: Scene, link: Link, ended: threading.Event) -> Iterator[None]:
    """An observer of the scene, in a thread."""

    def publish() -> None:
        publisher, p, seq = link.publisher(scene.keys.posterior("cam1")), random_posteriors(1)[0], 0
        while not ended.wait(1 / RATE_HZ):
            publisher.put(encode(message(seq, time.time_ns(), p)))
            seq += 1

    with _thread(publish, ended):
        yield


@contextmanager
def _bare_clients(endpoint: str) -> Iterator[list[int]]:
    """Two bare clients, one of which puts as often as the observer; yields the arrival times (ns) at the other."""
    arrived_ns: list[int] = []
    settings = {"mode": "client", "connect/endpoints": [endpoint], "connect/retry": RETRY}
    ended = threading.Event()
    with open_bare(settings) as here, open_bare(settings) as there:
        publisher = here.declare_publisher(BARE)

        def put() -> None:
            while not ended.wait(1 / RATE_HZ):
                publisher.put(b"x")

        with there.declare_subscriber(BARE, lambda _: arrived_ns.append(time.time_ns())), _thread(put, ended):
            yield arrived_ns


@contextmanager
def _thread(work: Callable[[], None], ended: threading.Event) -> Iterator[None]:
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(TIMEOUT_S)


def _next(inbox: Inbox) -> TimedJudgement:
    """The next judgement that is made after now."""
    now_ns = time.time_ns()
    return _first(inbox, lambda judgement: judgement.at_ns > now_ns)


def _first(inbox: Inbox, condition: Callable[[JudgementMessage], bool]) -> TimedJudgement:
    """The first judgement that fulfils the condition."""
    deadline = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline:
        for arrival in inbox.take(0.1):
            judgement = decode(JudgementMessage, arrival.payload)
            if condition(judgement):
                return TimedJudgement(judgement, arrival.arrived_ns)
    raise LabanmeshError(f"no judgement within {TIMEOUT_S:g} s; do `labanmesh router` and `labanmesh fuse` work here?")


def _wait_until(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while not condition():
        if time.monotonic() > deadline:
            raise LabanmeshError(f"not within {TIMEOUT_S:g} s: {what}")
        time.sleep(0.002)
