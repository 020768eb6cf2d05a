"""A hundred scenes on one hub: each verdict arrives once, and its memory stays; LABANMESH_LOAD_S says how long, at
least: memory is judged by LEAST movements, which a busy machine takes longer for."""

import os
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from mqtt_stage import Broker, Hub, Listener, mosquitto
from played_scene import LABELS, PlayedScene, hub_section
from processes import until

from common.config import MeshConfig
from common.link import Link
from common.same_movement import LIMIT

SCENES = 100
PAUSE_S = 0.6
LEAST = LIMIT + 12
GROWTH = 1.05
"""Memory of the second half over that of the first, once a hub remembers LIMIT movements of each scene."""


def memory_mb(pid):
    lines = Path(f"/proc/{pid}/status").read_text("ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


def test_no_verdict_of_a_hundred_scenes_is_lost_and_memory_is_flat(tmp_path):
    seconds = float(os.environ.get("LABANMESH_LOAD_S", "0"))
    if not seconds or not mosquitto():
        pytest.skip("LABANMESH_LOAD_S is not set, or there is no mosquitto: make test-home")
    with ExitStack() as stack:
        # Mosquitto drops what waits for a listener of a busy machine, beyond a thousand messages.
        broker = stack.enter_context(Broker(tmp_path / "broker", ("allow_anonymous true", "max_queued_messages 0")))
        link = stack.enter_context(Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]))
        observers = ("cam1", "cam2", "cam3", "cam4")
        section = hub_section(broker.port, movements=LABELS)
        rooms = [stack.enter_context(PlayedScene(f"scene{n:03}", observers, link, 0.2)) for n in range(SCENES)]
        files = [room.scene_file(tmp_path / f"{room.name}.toml", section) for room in rooms]
        listener = stack.enter_context(Listener(broker.port, "labanmesh/+/verdict", "labanmesh/+/ended", "+/+/state"))
        hub = Hub(*files).connected()
        stack.callback(hub.end)
        listener.wait_for(lambda: sum(topic.endswith("/state") for topic in listener.last) == SCENES)
        number, memory = perform(rooms, seconds, lambda: memory_mb(hub.process.pid))
        for kind in ("verdict", "ended"):
            wanted = {(room.name, f"{room.name}-{n}") for room in rooms for n in range(number)}
            until(
                lambda kind=kind, wanted=wanted: arrived(listener, kind) >= len(wanted),
                lambda kind=kind, wanted=wanted: f"{arrived(listener, kind)} of {len(wanted)} {kind}",
                60.0,
            )
            ids = [(r.name, event["id"]) for r in rooms for event in listener.events(f"labanmesh/{r.name}/{kind}")]
            assert len(ids) == len(wanted) and set(ids) == wanted
    # Of each scene a hub remembers so many movements.
    settled = memory[LIMIT:]
    first, second = (max(half) for half in (settled[: len(settled) // 2], settled[len(settled) // 2 :]))
    print(f"{number * SCENES} verdicts of {SCENES} scenes in {seconds:g} s; {first:.0f} MB, then {second:.0f} MB")
    assert second < first * GROWTH


def perform(rooms, seconds, measure):
    """LEAST movements in all rooms at once, and for this long: how many in each, and `measure()` after each."""
    pause, end_s, number, measured = threading.Event(), time.monotonic() + seconds, 0, []
    while time.monotonic() < end_s or number < LEAST:
        for ended in (False, True):
            for room in rooms:
                room.publish_verdict(LABELS[number % len(LABELS)], number, ended=ended)
            pause.wait(PAUSE_S)
        measured.append(measure())
        number += 1
    return number, measured


def arrived(listener, kind):
    return sum(topic.endswith(f"/{kind}") for _, topic, *_ in listener.messages)
