"""What each part of a fusion process costs, in microseconds of a processor, and how large its messages are.

1. Parts of a step: real courts on a real link, given 4, 8 and 16 posteriors: of four observers a court reads eight, so
   that what more come cost no more than the taking. One court after a nap, and many in a row: the first pays for what
   the processor has forgotten meanwhile. A referee alone hears and judges, a link alone says.
2. Zenoh's threads: a second process speaks in bursts, as a crowd does, while the loop sleeps.
"""

import multiprocessing
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.synchronize import Event
from statistics import median

from benchmarks.crowd.crowd import scene_name
from benchmarks.crowd.play import JUDGES, NAMES, Saying, belief
from benchmarks.crowd.trial import free_port
from common.config import MeshConfig, ObserverConfig, Scene
from common.errors import LabanmeshError
from common.health import Health
from common.inbox import Arrival, Presence
from common.keys import SceneKeys
from common.link import Link, Publisher
from common.messages import PosteriorMessage, StatusMessage, VerdictMessage
from common.wire import decode, encode, encode_vocabulary
from fusion.court import Court
from fusion.ear import Ear
from fusion.fleet import Fleet
from fusion.referee import Referee
from fusion.sharing import Duty

ROUNDS = 200
BURSTS_HZ = 240
BURSTS_S = 3.0
SMALL, LARGE = 12, 125
"""Posteriors a burst: of a hundred observers at 30 Hz in eight slots, and of a thousand."""
ARRIVED_S = 0.005
FLEET_SCENES = 200
COURTS = 16
STEPS = 60
MICRO = 1e6


def measured_parts() -> tuple[dict[str, float], dict[str, int]]:
    """Every cost of studies/scale/measured.py:Costs, and the sizes of messages in bytes."""
    bare, sizes = alone()
    with linked() as (link, endpoint, far):
        step = stepping(link, far, bare["hear"])
        voice = far.publisher(scene_of(0).keys.posterior("cam0"))
        say = spent(lambda: voice.put(bytes(sizes["judgement"])), ROUNDS) + bare.pop("encode")
        costs = {**bare, **hearing(link, endpoint), **step, "hop": hopping(link, voice), "round": rounds(link)}
    look = max(costs.pop("step") - costs["judge"] - say, 0.0)
    costs |= {"say": say, "look": look, "turn": turning()}
    return {name: round(cost, 2) for name, cost in costs.items()}, sizes


def alone() -> tuple[dict[str, float], dict[str, int]]:
    """What hearing, judging and encoding cost without a mesh; how large messages are."""
    scene = scene_of(0)
    keys, now_ns = scene.keys, time.time_ns()
    referee, health = Referee(scene.scene, list(scene.roster), NAMES, scene.fusion), Health(scene.scene, "fusion")
    ear = Ear(scene.scene, referee, health, lambda: now_ns)
    took: dict[str, list[float]] = {"hear": [], "judge": []}
    verdict: VerdictMessage | None = None
    for seq in range(ROUNDS):
        now_ns += 100_000_000
        said = sayings(scene.scene, NAMES.labels[3] if seq % 40 >= 20 else None)
        payloads = [saying.at(seq, now_ns - 20_000_000) for saying in said]
        begun_s = time.thread_time()
        for judge, payload in enumerate(payloads):
            ear.hear(Arrival(keys.posterior(f"cam{judge}"), payload, now_ns))
        heard_s = time.thread_time()
        ruling = referee.judge(now_ns)
        took["judge"].append(time.thread_time() - heard_s)
        took["hear"].append((heard_s - begun_s) / JUDGES)
        verdict = next(iter(ruling.verdicts), verdict)
    health.noticed(ear.accounts(scene.roster))
    one = decode(PosteriorMessage, said[0].at(seq, now_ns)).model_copy(
        update={"scene": None, "observer": None, "visible": None, "v": 2}
    )
    watching = StatusMessage(
        scene=scene.scene, id="cam0", state="running", rate_hz=30.0, last_frame_ns=now_ns, at_ns=now_ns
    )
    sizes = {"posterior": one, "judgement": ruling.judgement, "verdict": verdict, "observer_status": watching}
    lengths = {name: len(encode(message)) for name, message in sizes.items() if message is not None}
    lengths |= {
        "fusion_status": len(encode(health.status(now_ns))),
        "vocabulary": len(encode_vocabulary(scene.scene, NAMES)),
    }
    costs = {name: median(times) * MICRO for name, times in took.items()}
    return costs | {"encode": spent(lambda: encode(ruling.judgement), ROUNDS)}, lengths


@contextmanager
def linked() -> Iterator[tuple[Link, str, Link]]:
    """A link where others meet, its endpoint, and a second link that has met it."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        Link.open(MeshConfig(endpoint=endpoint), "fusion") as link,
        Link.open(MeshConfig(endpoint=endpoint), "observer") as far,
    ):
        yield link, endpoint, far


def stepping(link: Link, far: Link, hear: float) -> dict[str, float]:
    """What a court's step costs in a row of others and after a nap (`cold` more), by what came; telling, sitting."""
    sat = [seated(scene_of(n), link) for n in range(COURTS)]
    courts = [court for court, _ in sat]
    told = [Told(scene_of(n), far) for n in range(COURTS)]
    row = {each: median(_steps(courts, told, each)) / COURTS for each in (1, 2, 4)}
    nap = median(_steps(courts[:1], told[:1], 1))
    tell = spent(courts[0].tell, ROUNDS)
    for court in courts:
        court.close()
    take, sit = (row[4] - row[2]) / 8, median(cost for _, cost in sat)
    step = row[1] - JUDGES * (take + hear)
    return {"take": take, "step": step, "cold": max(nap - row[1], 0.0), "tell": tell, "sit": sit}


class Told:
    """The four observers of a scene."""

    def __init__(self, scene: Scene, far: Link) -> None:
        self._voices = [far.publisher(scene.keys.posterior(f"cam{judge}")) for judge in range(JUDGES)]
        self._sayings, self._seq = sayings(scene.scene, NAMES.labels[3]), 0
        if not all(voice.wait_for_subscriber(10) for voice in self._voices):
            raise LabanmeshError("the court did not listen to its observers within 10 s")

    def say(self, times: int) -> None:
        """Each so many times."""
        for _ in range(times):
            self._seq += 1
            for voice, saying in zip(self._voices, self._sayings, strict=True):
                voice.put(saying.at(self._seq, time.time_ns()))


def _steps(courts: Sequence[Court], told: Sequence[Told], each: int) -> Iterator[float]:
    """Microseconds of one step of each court, where all that was said had come."""
    for _ in range(STEPS):
        for one in told:
            one.say(each)
        time.sleep(ARRIVED_S)
        begun_s = time.thread_time()
        came = [court.step().arrived for court in courts]
        took_s = time.thread_time() - begun_s
        if came == [each * JUDGES] * len(courts):
            yield took_s * MICRO


def seated(scene: Scene, link: Link) -> tuple[Court, float]:
    """A court that judges its scene, and what it cost to come to that."""
    court = Court(scene, lambda: Referee(scene.scene, list(scene.roster), NAMES, scene.fusion), link, time.time_ns)
    begun_s = time.thread_time()
    court.present(())
    cost_s, end_s = time.thread_time() - begun_s, time.monotonic() + 5
    while court.duty is not Duty.JUDGING:
        if time.monotonic() > end_s:
            raise LabanmeshError("a court that is alone did not take its scene within 5 s")
        time.sleep(ARRIVED_S)
        court.step()
    return court, cost_s * MICRO


def rounds(link: Link) -> float:
    """What a scene that is not due costs in each round."""
    fleet = Fleet([scene_of(n) for n in range(FLEET_SCENES)], link, time.time_ns)

    class Unknown(Presence):
        alive = None  # type: ignore[assignment]

    took = spent(lambda: fleet.round(Unknown()), ROUNDS)
    return took / FLEET_SCENES


def turning() -> float:
    """What it costs to wait for a moment and come back."""
    return spent(lambda: threading.Event().wait(ARRIVED_S), ROUNDS)


def hearing(link: Link, endpoint: str) -> dict[str, float]:
    """What Zenoh's threads spend on what comes: into rings, and through callbacks."""
    key = SceneKeys("burst").posterior("*")
    with link.branch(polled=True) as polled:
        polled.inbox(key)
        small, large = bursts(endpoint, SMALL), bursts(endpoint, LARGE)
    each = max((large - small) / (LARGE - SMALL), 0.0)
    with link.branch() as called:
        called.inbox(key)
        call = bursts(endpoint, SMALL)
    burst = max(small - SMALL * each, 0.0)
    return {"receive": each, "burst": burst, "call": (call - burst) / SMALL}


def bursts(endpoint: str, size: int) -> float:
    """Processor time of this process for each burst that another speaks, in microseconds, over that of silence."""
    begun_s = time.process_time()
    time.sleep(BURSTS_S / 2)
    idle_s = (time.process_time() - begun_s) * 2
    context = multiprocessing.get_context("spawn")
    ready, go = context.Event(), context.Event()
    other = context.Process(target=speak, args=(endpoint, size, ready, go))
    other.start()
    if not ready.wait(20):
        raise LabanmeshError("the speaking process met nobody within 20 s")
    begun_s = time.process_time()
    go.set()
    other.join()
    return (time.process_time() - begun_s - idle_s) * MICRO / (BURSTS_HZ * BURSTS_S)


def speak(endpoint: str, size: int, ready: Event, go: Event) -> None:
    """In a process of its own: bursts of posteriors for BURSTS_S."""
    saying = sayings("burst", None)[0]
    with Link.open(MeshConfig(endpoint=endpoint), "observer") as link:
        voices = [link.publisher(SceneKeys("burst").posterior(f"cam{n}")) for n in range(size)]
        if all(voice.wait_for_subscriber(10) for voice in voices):
            ready.set()
        go.wait(10)
        due_s = time.monotonic()
        for number in range(round(BURSTS_HZ * BURSTS_S)):
            said = saying.at(number, time.time_ns())
            for voice in voices:
                voice.put(said)
            due_s += 1 / BURSTS_HZ
            time.sleep(max(due_s - time.monotonic(), 0))


def hopping(link: Link, voice: Publisher) -> float:
    """From a put until the message is there, in microseconds."""
    inbox, took = link.inbox(SceneKeys(scene_name(0)).posterior()), []
    voice.wait_for_subscriber(10)
    for _ in range(ROUNDS):
        put_ns = time.time_ns()
        voice.put(b"hop")
        took += [(arrival.arrived_ns - put_ns) / 1e3 for arrival in inbox.take(1.0)]
        time.sleep(ARRIVED_S)
    return median(took)


def scene_of(number: int) -> Scene:
    """A scene of the crowd."""
    judges = {f"cam{judge}": ObserverConfig(source="simulated") for judge in range(JUDGES)}
    return Scene(scene=scene_name(number), vocabulary=NAMES.labels, vocabulary_name=NAMES.name, observers=judges)


def sayings(scene: str, label: str | None) -> list[Saying]:
    """What the four say when `label` is done, or nothing."""
    return [Saying(scene, f"cam{judge}", *belief(label, judge)) for judge in range(JUDGES)]


def spent(work: Callable[[], object], rounds: int) -> float:
    """Processor time of this thread, in microseconds a call: the median."""
    took = []
    for _ in range(rounds):
        begun_s = time.thread_time()
        work()
        took.append(time.thread_time() - begun_s)
    return median(took) * MICRO
