"""From nothing to a lamp, with real processes: up, teach, hub, mosquitto, Home Assistant. The person is SYNTHETIC. It
plays a person who does what `labanmesh teach` asks for, as tracks of one camera, and prints how long each step took:
the times in docs/guide/home.md. LABANMESH_MINUTES is how much ordinary life it is shown."""

import json
import os
import re
import subprocess
import threading
import time

import numpy as np
import pytest
from home_assistant import HomeAssistant
from mqtt_stage import Broker, Listener, mosquitto
from played_scene import ROOT, environment
from processes import labanmesh, until

from benchmarks.timing import free_port
from common.config import MeshConfig
from common.link import Link
from observer.tracks import BODY_PARTS

RATE_HZ = 15
REST = np.array([[280.0, 300.0], [360.0, 300.0], [320.0, 100.0]])
LIFTS = {
    "wave": ((0, 0), (30, -220), (0, 0)),
    "point": ((-200, -120), (0, 0), (0, 0)),
    "reach": ((0, 0), (150, 40), (20, 60)),
}
SCENE = """scene = "home"
[mesh]
endpoint = "tcp/127.0.0.1:{mesh}"
[hub]
start = ["mqtt"]
[hub.mqtt]
port = {broker}
[observers.sofa]
source = "zenoh:tracks/sofa"
view = "camera"
"""
LAMP = {"name": "Lamp", "unique_id": "lamp", "object_id": "lamp", "command_topic": "lamp/set"}
BLUEPRINT = ROOT / "deploy/home-assistant/blueprints/automation/labanmesh/gesture_toggle.yaml"


class Person:
    """Stands in front of the camera, and does a movement when told; a context manager that publishes the tracks."""

    def __init__(self, endpoint):
        self._mesh, self._due, self._stop = MeshConfig(endpoint=endpoint), [], threading.Event()
        self._thread = threading.Thread(target=self._stand)

    def do(self, movement, seconds=1.8):
        course = np.sin(np.pi * np.linspace(0, 1, round(seconds * RATE_HZ)))[:, None, None]
        self._due.extend(REST + course * np.array(LIFTS[movement]))

    @property
    def rests(self):
        return not self._due

    def _stand(self):
        noise = np.random.default_rng(1)
        with Link.open(self._mesh, "observer") as link:
            tracks = link.publisher("tracks/sofa")
            while not self._stop.wait(1 / RATE_HZ):
                places = (self._due.pop(0) if self._due else REST) + noise.normal(0, 1.5, REST.shape)
                parts = dict(zip(BODY_PARTS, places.tolist(), strict=True))
                tracks.put(json.dumps({"captured_ns": time.time_ns(), "parts": parts}).encode())

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()


class Clock:
    """Prints how long each step took."""

    def __init__(self):
        self._since_s = time.monotonic()

    def step(self, what):
        print(f"{time.monotonic() - self._since_s:6.1f} s  {what}")
        self._since_s = time.monotonic()


def lesson(person, file, minutes):
    """Run `labanmesh teach`, and do what it asks for; returns its lines."""
    words = ["teach", file, "wave", "point", "--background-minutes", minutes]
    lines = []
    with subprocess.Popen(labanmesh(*words), stdout=subprocess.PIPE, text=True, cwd=ROOT, env=environment()) as teach:
        for line in teach.stdout:
            lines.append(line.rstrip())
            asked = re.search(r"(\w+)(?: \d+ of \d+)?: now$", lines[-1])
            if asked and asked[1] in LIFTS:
                person.do(asked[1])
            elif "minutes of something else" in line:
                for _ in range(round(60 * float(minutes) / 5)):
                    person.do("reach", 3.0)
    assert teach.returncode == 0, lines
    return lines


@pytest.fixture
def place(tmp_path):
    """A broker, a Home Assistant with a lamp, and a scene file without a model."""
    program = os.environ.get("LABANMESH_HASS")
    if not program or not mosquitto():
        pytest.skip("LABANMESH_HASS is not set, or there is no mosquitto: make test-home")
    with (
        Broker(tmp_path / "broker") as broker,
        HomeAssistant(program, tmp_path / "home", broker.port) as home,
        Listener(broker.port, "lamp/set") as lamp,
    ):
        lamp.client.publish("homeassistant/light/lamp/config", json.dumps(LAMP), retain=True)
        home.wait_for_state("light.lamp", "unknown")
        mesh = free_port()
        (tmp_path / "scene.toml").write_text(SCENE.format(mesh=mesh, broker=broker.port))
        with Person(f"tcp/127.0.0.1:{mesh}") as person:
            yield home, person, tmp_path / "scene.toml"


def test_a_taught_movement_switches_a_lamp(place):
    home, person, file = place
    clock = Clock()
    with subprocess.Popen(labanmesh("up", file), cwd=ROOT, env=environment(), stderr=subprocess.DEVNULL) as scene:
        try:
            home.wait_for_state("sensor.home_sofa_state", "degraded", 60)
            clock.step("labanmesh up, until Home Assistant shows the observer")
            lines = lesson(person, file, os.environ.get("LABANMESH_MINUTES", "0.2"))
            print(*lines, sep="\n")
            clock.step("labanmesh teach, two movements, five takes each")
            until(lambda: set(home.offered("home")) == {"wave", "point"}, lambda: home.offered("home"))
            clock.step("until Home Assistant offers the movements")
            home.send(
                {
                    "type": "blueprint/save",
                    "domain": "automation",
                    "path": "labanmesh/a.yaml",
                    "yaml": BLUEPRINT.read_text(),
                }
            )
            given = {"movement": [home.offered("home")["wave"]], "target": {"entity_id": "light.lamp"}}
            home.save_automation("lamp", {"use_blueprint": {"path": "labanmesh/a.yaml", "input": given}})
            clock.step("blueprint and automation, without the clicks of a person")
            until(lambda: person.rests, "rest")
            person.do("wave")
            home.wait_for_state("light.lamp", "on")
            clock.step("from the begin of the wave to the lamp (the wave takes 1.8 s)")
        finally:
            scene.terminate()
