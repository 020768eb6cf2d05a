"""A scene that is taught: real processes, and a recorded person before two cameras who does what the lesson asks. The
person looks at the lesson as a second phone would, and performs when it says "now": recordings of MSR Action3D, as seen
from two places, where LABANMESH_DATA names them, else the synthetic performer."""

import json
import os
import re
import subprocess
import threading
import time
from pathlib import Path

import httpx
import numpy as np
from played_scene import ROOT, environment
from processes import SOON_S, labanmesh, until

from benchmarks.timing import free_port
from common.config import MeshConfig
from common.link import Link
from observer.geometry.projection import project
from observer.geometry.views import parse_view
from observer.motion.importers import import_recordings
from observer.tracks import BODY_PARTS
from studies.performer import perform

CAMERAS = {"sofa": "yaw:20", "shelf": "yaw:-50"}
RECORDED = {"wave": "high_arm_wave", "clap": "hand_clap"}
PERFORMED = {"wave": "byebye", "clap": "nthrow"}
FED = {name: f'source = "zenoh:tracks/{name}"\nview = "camera"\n' for name in CAMERAS}
RATE_HZ = 15.0
BUSY_S = 120.0
"""How long five processes may take to start on a machine that does much else."""
SIZE = 640


def performances():
    """By label the performances of one person, (F, P, 3) m; and the names of the parts."""
    place = os.environ.get("LABANMESH_DATA")
    if place:
        archive, names, subject = import_recordings("msr-action3d", Path(place) / "msr_action3d").archive, RECORDED, "2"
    else:
        archive, names, subject = perform(("2",), tuple(PERFORMED.values()), trials=3), PERFORMED, "2"
    rows = [archive.body_parts.index(part) for part in BODY_PARTS]
    return {
        label: [r.positions[:, rows] for r in archive.recordings if (r.label, r.subject) == (name, subject)]
        for label, name in names.items()
    }


def teach_address(lines):
    """The address and the token that a dashboard with a Teach page prints."""
    for line in lines:
        if match := re.match(r"teach at (http://\S+)/teach#(\S+)", line):
            return match[1], match[2]
    raise AssertionError("the dashboard has ended")


class Performer:
    """Publishes the tracks of both cameras fifteen times a second; a context manager. away: cameras that see nobody."""

    def __init__(self, endpoint, lesson):
        self._lesson, self._moves, self._turn, self.away = lesson, performances(), {}, frozenset()
        self._link = Link.open(MeshConfig(endpoint=endpoint), "hub")
        self._publishers = {name: self._link.publisher(f"tracks/{name}") for name in CAMERAS}
        self._rng, self._stop = np.random.default_rng(3), threading.Event()
        self._rest = next(iter(self._moves.values()))[0][0]
        self._thread = threading.Thread(target=self._perform)

    def _perform(self):
        done = None
        while not self._stop.is_set():
            number, label = self._lesson()
            if label in self._moves and number != done:
                done = number
                self._play(self._next(label))
            self._show(self._rest)

    def _next(self, label):
        """The label's performances in turn, from the posture of rest and back to it."""
        turn = self._turn[label] = self._turn.get(label, -1) + 1
        movement = self._moves[label][turn % len(self._moves[label])]
        ways = np.linspace(0, 1, 5)[:, None, None]
        return [
            *(self._rest + ways * (movement[0] - self._rest)),
            *movement,
            *(movement[-1] + ways * (self._rest - movement[-1])),
        ]

    def _play(self, frames):
        for positions in frames:
            self._show(positions)

    def _show(self, positions):
        for name, view in CAMERAS.items():
            seen = 200 * project(parse_view(view).matrix, positions[None].astype(float))[0] + SIZE / 2
            seen = seen + self._rng.normal(0, 1.0, seen.shape)
            places = [None] * len(BODY_PARTS) if name in self.away else seen.round(1).tolist()
            line = {"captured_ns": time.time_ns(), "parts": dict(zip(BODY_PARTS, places, strict=True))}
            self._publishers[name].put(json.dumps(line).encode())
        self._stop.wait(1 / RATE_HZ)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        self._link.close()


class TaughtScene:
    """Fusion, observers that wait to be taught, and a dashboard with a Teach page; a context manager. observers: their
    sections in the scene file; by default two that a performer stands before."""

    def __init__(self, folder, observers=FED):
        self.folder, self.file, self._processes, self._observers = folder, folder / "home.toml", [], observers
        self.endpoint, self._known = f"tcp/127.0.0.1:{free_port()}", (0, "")
        sections = "".join(f"[observers.{name}]\n{section}" for name, section in observers.items())
        mesh = f'[mesh]\nendpoint = "{self.endpoint}"\n[fusion]\nquorum = 1\n'
        self.file.write_text(f'scene = "home"\n{mesh}{sections}')

    def _start(self, *words):
        with (self.folder / f"{words[0]}-{len(self._processes)}.log").open("w") as log:
            process = subprocess.Popen(
                labanmesh(*words), cwd=ROOT, env=environment(), stdout=subprocess.PIPE if "dashboard" in words else log,
                stderr=log, text=True,
            )  # fmt: skip
        self._processes.append(process)
        return process

    def start_dashboard(self):
        self.dashboard = self._start("dashboard", self.file, "--teach", "--listen", f"127.0.0.1:{self.port}")
        self.url, self.token = teach_address(self.dashboard.stdout)

    def state(self):
        """How the lesson stands, as a second phone sees it."""
        headers = {"authorization": f"Bearer {self.token}"}
        return httpx.get(f"{self.url}/teach/state", headers=headers, timeout=SOON_S).json()

    def lesson(self):
        """The number of the step and the movement that is to be done now; "" for none."""
        return self._known

    def _watch(self):
        while not self._stop.wait(0.1):
            try:
                lesson = self.state()["lesson"]
            except (httpx.HTTPError, ValueError):
                continue
            now = lesson is not None and not lesson["over"] and lesson["step"]["kind"] == "now"
            self._known = (lesson["number"], lesson["step"]["label"]) if now else (0, "")

    def __enter__(self):
        self.port = free_port()
        self._start("fuse", self.file)
        self.start_dashboard()
        for name in self._observers:
            self._start("observe", self.file, name)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()
        self.performer = Performer(self.endpoint, self.lesson).__enter__()
        until(lambda: all(each.get("pictures") for each in self.state()["observers"]), "the observers see", BUSY_S)
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        self.performer.__exit__()
        for process in self._processes:
            process.terminate()
        for process in self._processes:
            process.communicate(timeout=SOON_S)
