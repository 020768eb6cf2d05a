"""What Zenoh's threads spend: on what comes to a process, and in a router on what it passes on.

A second process speaks in bursts, as a crowd does, while the loop of the first one sleeps.
"""

import multiprocessing
import os
import time
from multiprocessing.synchronize import Event
from pathlib import Path

from benchmarks.crowd.crowd import JUDGES, NAMES, Saying, belief, scene_name
from benchmarks.crowd.trial import free_port
from common.config import MeshConfig, ObserverConfig, Scene
from common.errors import LabanmeshError
from common.keys import SceneKeys
from common.link import Link

TICKS_S = 1 / os.sysconf("SC_CLK_TCK")
SOON_S = 20.0
MICRO = 1e6
BURSTS_HZ = 240
BURSTS_S = 3.0
SMALL, LARGE = 12, 125
"""Posteriors a burst: of a hundred observers at 30 Hz in eight slots, and of a thousand."""
SUBSCRIBED = 1000
"""Keys that a link listens to when what comes is counted: all observers of FLEET_SCENES scenes, and some."""


def hearing(link: Link, endpoint: str) -> dict[str, float]:
    """What Zenoh's threads spend on what comes: into rings, of a link that listens to many more; and to a thread."""
    key = SceneKeys("burst").posterior
    with link.sub_session(polled=True) as polled:
        polled.inbox(*(key(f"cam{n}") for n in range(SUBSCRIBED)), ring=1)
        small, large = bursts(endpoint, SMALL), bursts(endpoint, LARGE)
    each = max((large - small) / (LARGE - SMALL), 0.0)
    with link.sub_session() as called:
        called.inbox(key("*"))
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
    other = context.Process(target=speak, args=(MeshConfig(endpoint=endpoint), size, ready, go))
    other.start()
    if not ready.wait(20):
        raise LabanmeshError("the speaking process met nobody within 20 s")
    begun_s = time.process_time()
    go.set()
    other.join()
    return (time.process_time() - begun_s - idle_s) * MICRO / (BURSTS_HZ * BURSTS_S)


def speak(mesh: MeshConfig, size: int, ready: Event, go: Event) -> None:
    """In a process of its own: bursts of posteriors for BURSTS_S."""
    saying = sayings("burst", None)[0]
    with Link.open(mesh, "observer") as link:
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


def forwarding() -> float:
    """Microseconds of the router's processor for a message; who speaks is a process of its own, who listens is here."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    mesh = MeshConfig(mode="router", endpoint=endpoint)
    context = multiprocessing.get_context("spawn")
    up, stop, ready, go = context.Event(), context.Event(), context.Event(), context.Event()
    router = context.Process(target=route, args=(mesh, up, stop))
    router.start()
    try:
        if not up.wait(SOON_S):
            raise LabanmeshError(f"the router did not listen within {SOON_S:.0f} s")
        with Link.open(mesh, "hub") as link, link.sub_session(polled=True) as rings:
            rings.inbox(SceneKeys("burst").posterior("*"))
            speaker = context.Process(target=speak, args=(mesh, LARGE, ready, go))
            speaker.start()
            if not ready.wait(SOON_S):
                raise LabanmeshError(f"nobody met over the router within {SOON_S:.0f} s")
            begun_s = _spent_s(router.pid)
            go.set()
            speaker.join()
            return (_spent_s(router.pid) - begun_s) * MICRO / (BURSTS_HZ * BURSTS_S * LARGE)
    finally:
        stop.set()
        router.join()


def route(mesh: MeshConfig, up: Event, stop: Event) -> None:
    """In a process of its own: the router."""
    with Link.open(mesh, "router", listen=[mesh.endpoint]):
        up.set()
        stop.wait()


def _spent_s(pid: int | None) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * TICKS_S


def scene_of(number: int) -> Scene:
    """A scene of the crowd."""
    judges = {f"cam{judge}": ObserverConfig(source="simulated") for judge in range(JUDGES)}
    return Scene(scene=scene_name(number), vocabulary=NAMES.labels, vocabulary_name=NAMES.name, observers=judges)


def sayings(scene: str, label: str | None) -> list[Saying]:
    """What the four say when `label` is done, or nothing."""
    return [Saying(scene, f"cam{judge}", *belief(label, judge)) for judge in range(JUDGES)]
