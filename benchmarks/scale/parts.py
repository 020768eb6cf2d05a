"""The cost of each part of a fusion process in microseconds of processor time, and the sizes of its messages.

1. Rounds of a fusion server on a real link with a few scenes due, and with a full batch: the difference is the cost per
   scene, the rest is shared by all. Receiving, publishing and emptying inboxes are measured alone and subtracted; the
   rest of a scene's cost is the judging.
2. Zenoh's threads: a second process publishes in bursts, as a crowd does, while the loop of the first one sleeps.
3. Everything is measured in ROUNDS rounds, of which the medians count.
"""

import multiprocessing
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing.synchronize import Event
from statistics import median
from unittest.mock import patch

from benchmarks.crowd.crowd import NAMES, OBSERVERS, scene_name, templates
from benchmarks.timing import free_port
from common.config import MeshConfig, ObserverConfig, Scene
from common.errors import LabanmeshError
from common.inbox import Arrival
from common.keys import SceneKeys
from common.link import Link, Publisher
from common.messages import AnyMessage, PosteriorMessage, StatusMessage, VerdictMessage
from common.notify import Notifier
from common.status import ProcessStatus
from common.wire import decode, encode, encode_vocabulary
from fusion.ingest import PosteriorIngest
from fusion.server import BATCH, FusionServer
from studies.fusion_engine import FusionEngine

ROUNDS = 3
CALLS = 200
ARRIVED_S = 0.005
IDLE_SCENES = 200
STEPS = 30
FEW = 4
OWNED_TIMEOUT_S = 5.0
TIMEOUT_S = 20.0
MICRO = 1e6
BURSTS_HZ = 240
BURSTS_S = 3.0
SMALL, LARGE = 12, 125
"""Posteriors per burst: of a hundred observers at 30 Hz in eight slots, and of a thousand."""
SUBSCRIBED = 1000
"""Keys to which the measured link subscribes."""


@dataclass(frozen=True, slots=True)
class Endpoints:
    """A link that listens, its endpoint, and a second link that has connected to it."""

    link: Link
    endpoint: str
    far: Link


@dataclass(frozen=True, slots=True)
class RoundCost:
    """Microseconds of a round of the server, and of taking over one scene."""

    round_us: float
    take_over_us: float


def measure_parts() -> tuple[dict[str, float], dict[str, int]]:
    """Every cost of benchmarks/scale/measured.py:Costs, and the sizes of messages in bytes."""
    rounds = [_measure_once() for _ in range(ROUNDS)]
    return {name: round(median(costs[name] for costs, _ in rounds), 2) for name in rounds[0][0]}, rounds[-1][1]


def _measure_once() -> tuple[dict[str, float], dict[str, int]]:
    bare, sizes = _without_mesh()
    with _connected() as ends:
        step = _step_costs(ends)
        take = _take_cost(ends)
        publisher = ends.far.publisher(_scene(0).keys.posterior("cam0"))
        publish = _cpu_us(lambda: publisher.put(bytes(sizes["judgement"]))) + bare.pop("encode")
        status = _cpu_us(lambda: publisher.put(bytes(sizes["fusion_status"]))) + bare.pop("status")
        threads = _receiving_costs(ends.link, ends.endpoint)
        rest = {"hop": _hop_us(ends.link, publisher), "round": _idle_cost(ends.link), "turn": _wait_cost()}
    judge = max(step.pop("step") - OBSERVERS * (take + bare["decode"]) - publish, 0.0)
    own = {"take": take, "judge": judge, "publish": publish, "status": status}
    return {**bare, **threads, **step, **rest, **own}, sizes


def _scene(number: int) -> Scene:
    observers = {f"cam{n}": ObserverConfig(source="simulated") for n in range(OBSERVERS)}
    return Scene(scene=scene_name(number), vocabulary=NAMES.labels, vocabulary_name=NAMES.name, observers=observers)


def _without_mesh() -> tuple[dict[str, float], dict[str, int]]:
    """The costs of receiving and encoding, and the sizes of messages."""
    scene = _scene(0)
    keys, now_ns = scene.keys, time.time_ns()
    engine = FusionEngine(scene.scene, list(scene.roster), NAMES, scene.fusion)
    status = ProcessStatus(scene.scene, "fusion")
    ingest = PosteriorIngest(engine)
    took_s: list[float] = []
    verdict: VerdictMessage | None = None
    for seq in range(CALLS):
        now_ns += 100_000_000
        own = templates(NAMES.labels[3] if seq % 40 >= 20 else None)
        payloads = [template.at(seq, now_ns - 20_000_000) for template in own]
        begun_s = time.thread_time()
        for n, payload in enumerate(payloads):
            posteriors = ingest.read([Arrival(keys.posterior(f"cam{n}"), payload, now_ns)], now_ns)
            status.record_frames(ingest.pass_on(posteriors, engine, now_ns), now_ns)
        took_s.append((time.thread_time() - begun_s) / OBSERVERS)
        output = engine.step(now_ns)
        verdict = next(iter(output.verdicts), verdict)
    status.observers = ingest.statistics(scene.roster)
    observer = StatusMessage(
        scene=scene.scene, id="cam0", state="running", rate_hz=30.0, last_frame_ns=now_ns, at_ns=now_ns
    )
    messages: dict[str, AnyMessage | None] = {
        "posterior": decode(PosteriorMessage, payloads[0]),
        "judgement": output.judgement,
        "verdict": verdict,
        "observer_status": observer,
        "fusion_status": status.status(now_ns),
    }
    sizes = {name: len(encode(message)) for name, message in messages.items() if message is not None}
    sizes["vocabulary"] = len(encode_vocabulary(scene.scene, NAMES))
    encoding = _cpu_us(lambda: encode(output.judgement))
    status_us = _cpu_us(lambda: encode(status.status(now_ns)))
    return {"decode": median(took_s) * MICRO, "encode": encoding, "status": status_us}, sizes


@contextmanager
def _connected() -> Iterator[Endpoints]:
    mesh = MeshConfig(endpoint=f"tcp/127.0.0.1:{free_port()}")
    with Link.open(mesh, "fusion") as link, Link.open(mesh, "observer") as far:
        yield Endpoints(link, mesh.endpoint, far)


def _step_costs(ends: Endpoints) -> dict[str, float]:
    """The cost per due scene, the shared cost of a round, and the cost of taking over a scene."""
    few, many = (_round_cost(count, ends) for count in (FEW, BATCH))
    each = (many.round_us - few.round_us) / (BATCH - FEW)
    return {"step": each, "cold": max(few.round_us - FEW * each, 0.0), "take_over": many.take_over_us}


def _round_cost(count: int, ends: Endpoints) -> RoundCost:
    scenes = [_scene(n) for n in range(count)]
    end_s = time.monotonic() + OWNED_TIMEOUT_S
    with _polled_server(scenes, ends.link) as server:
        begun_s = time.thread_time()
        owned = server.step().owned
        while owned < count:
            if time.monotonic() > end_s:
                raise LabanmeshError(
                    f"a fusion server without others did not take its scenes within {OWNED_TIMEOUT_S:g} s"
                )
            owned = server.step().owned
        take_over_s = (time.thread_time() - begun_s) / count
        observers, took_s = [SceneObservers(scene, ends.far) for scene in scenes], []
        for _ in range(STEPS):
            for own in observers:
                own.publish()
            time.sleep(1.1 / scenes[0].fusion.step_hz)
            begun_s = time.thread_time()
            server.step()
            took_s.append(time.thread_time() - begun_s)
    return RoundCost(median(took_s) * MICRO, take_over_s * MICRO)


def _take_cost(ends: Endpoints) -> float:
    """Microseconds to empty an inbox of one posterior, minus those of an empty inbox."""
    scenes = [_scene(n) for n in range(BATCH)]
    sessions = [ends.link.sub_session(polled=True) for _ in scenes]
    keys = [map(scene.keys.posterior, scene.roster) for scene in scenes]
    inboxes = [session.newest(*own) for session, own in zip(sessions, keys, strict=True)]
    observers = [SceneObservers(scene, ends.far) for scene in scenes]
    full = len(observers) * OBSERVERS
    took_us: dict[int, list[float]] = {0: [], full: []}
    for number in range(2 * STEPS):
        for own in observers if number % 2 else ():
            own.publish()
        time.sleep(ARRIVED_S)
        begun_s = time.thread_time()
        arrived = sum(len(inbox.take()) for inbox in inboxes)
        took_us.setdefault(arrived, []).append((time.thread_time() - begun_s) * MICRO)
    for session in sessions:
        session.close()
    return max(median(took_us[full]) - median(took_us[0]), 0.0) / full


class SceneObservers:
    """The four observers of a scene."""

    def __init__(self, scene: Scene, far: Link) -> None:
        self._publishers = [far.publisher(scene.keys.posterior(f"cam{n}")) for n in range(OBSERVERS)]
        self._templates, self._seq = templates(NAMES.labels[3]), 0
        if not all(publisher.wait_for_subscriber(10) for publisher in self._publishers):
            raise LabanmeshError("the fusion server did not subscribe to its observers within 10 s")

    def publish(self) -> None:
        """One posterior of each."""
        self._seq += 1
        for publisher, template in zip(self._publishers, self._templates, strict=True):
            publisher.put(template.at(self._seq, time.time_ns()))


def _idle_cost(link: Link) -> float:
    """Microseconds per round of a scene that is not due."""
    scenes = [_scene(n) for n in range(IDLE_SCENES)]
    slow = [scene.model_copy(update={"fusion": scene.fusion.model_copy(update={"step_hz": 0.1})}) for scene in scenes]
    with _polled_server(slow, link) as server:
        return _cpu_us(server.step) / IDLE_SCENES


@contextmanager
def _polled_server(scenes: Sequence[Scene], link: Link) -> Iterator[FusionServer]:
    """A server of many scenes that never pauses."""
    with patch.multiple("fusion.server", FEW_SCENES=0, BATCH_PAUSE_S=0.0):
        server = FusionServer(scenes, "fusion", link, time.time_ns, shared=True, supervisor=Notifier(""))
        with closing(server):
            server.join()
            yield server


def _wait_cost() -> float:
    """Microseconds to wait for a moment and wake up."""
    return _cpu_us(lambda: threading.Event().wait(ARRIVED_S))


def _hop_us(link: Link, publisher: Publisher) -> float:
    """Microseconds from a put to the arrival."""
    inbox, took_us = link.inbox(SceneKeys(scene_name(0)).posterior()), []
    publisher.wait_for_subscriber(10)
    for _ in range(CALLS):
        put_ns = time.time_ns()
        publisher.put(b"hop")
        took_us += [(arrival.arrived_ns - put_ns) / 1e3 for arrival in inbox.take(1.0)]
        time.sleep(ARRIVED_S)
    return median(took_us)


def _cpu_us(work: Callable[[], object], calls: int = CALLS) -> float:
    """Processor time of this thread per call, in microseconds: the median."""
    took_s = []
    for _ in range(calls):
        begun_s = time.thread_time()
        work()
        took_s.append(time.thread_time() - begun_s)
    return median(took_s) * MICRO


def _receiving_costs(link: Link, endpoint: str) -> dict[str, float]:
    """Microseconds of Zenoh's threads per posterior and burst into rings, and per posterior with a callback thread."""
    key = SceneKeys("burst").posterior
    with link.sub_session(polled=True) as polled:
        polled.newest(*(key(f"cam{n}") for n in range(SUBSCRIBED)))
        small, large = _burst_cost(endpoint, SMALL), _burst_cost(endpoint, LARGE)
    each = max((large - small) / (LARGE - SMALL), 0.0)
    with link.sub_session() as called:
        called.inbox(key("*"))
        call = _burst_cost(endpoint, SMALL)
    burst = max(small - SMALL * each, 0.0)
    return {"receive": each, "burst": burst, "call": (call - burst) / SMALL}


def _burst_cost(endpoint: str, size: int) -> float:
    """Processor time of this process per burst that another process publishes, in microseconds, minus idle time."""
    begun_s = time.process_time()
    time.sleep(BURSTS_S / 2)
    idle_s = (time.process_time() - begun_s) * 2
    context = multiprocessing.get_context("spawn")
    ready, go = context.Event(), context.Event()
    other = context.Process(target=publish_bursts, args=(MeshConfig(endpoint=endpoint), size, ready, go))
    other.start()
    if not ready.wait(TIMEOUT_S):
        raise LabanmeshError(f"the publishing process found no subscriber within {TIMEOUT_S:g} s")
    begun_s = time.process_time()
    go.set()
    other.join()
    return (time.process_time() - begun_s - idle_s) * MICRO / (BURSTS_HZ * BURSTS_S)


def publish_bursts(mesh: MeshConfig, size: int, ready: Event, go: Event) -> None:
    """In its own process: bursts of posteriors for BURSTS_S."""
    template = templates(None)[0]
    with Link.open(mesh, "observer") as link:
        publishers = [link.publisher(SceneKeys("burst").posterior(f"cam{n}")) for n in range(size)]
        if all(publisher.wait_for_subscriber(10) for publisher in publishers):
            ready.set()
        go.wait(10)
        due_s = time.monotonic()
        for number in range(round(BURSTS_HZ * BURSTS_S)):
            payload = template.at(number, time.time_ns())
            for publisher in publishers:
                publisher.put(payload)
            due_s += 1 / BURSTS_HZ
            time.sleep(max(due_s - time.monotonic(), 0))
