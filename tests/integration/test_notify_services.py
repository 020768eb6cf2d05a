"""The notifications of each service to systemd, on a real socket: ready, work done, status, stopping."""

import signal
import socket
import subprocess
import sys
import threading
from contextlib import nullcontext
from pathlib import Path

import pytest
from mesh_stage import FakePipeline, believed

from common.config import MeshConfig, read_scene
from common.errors import BadInput
from common.link import Link
from common.messages import StatusMessage
from common.wire import encode
from fusion.server import serve as serve_fusion
from observer.runtime.service import serve as serve_observer
from observer.tracks import Frame

ROOT = Path(__file__).parents[2]
SOON_S = 20.0
OBSERVERS = '[observers.cam1]\nsource = "m.npz"\n'


class Supervisor:
    """systemd's side of the socket."""

    def __init__(self, address):
        self.address, self.lines = address, []
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(address)
        self._socket.settimeout(SOON_S)

    def wait_for(self, wanted):
        """Read until a line that begins so; returns it."""
        while True:
            try:
                lines = self._socket.recv(4096).decode().splitlines()
            except TimeoutError:
                raise AssertionError(f"no {wanted} after {self.lines}") from None
            self.lines += lines
            for line in lines:
                if line.startswith(wanted):
                    return line

    def close(self):
        self._socket.close()


@pytest.fixture
def supervisor(tmp_path, monkeypatch):
    opened = Supervisor(str(tmp_path / "notify"))
    monkeypatch.setenv("NOTIFY_SOCKET", opened.address)
    yield opened
    opened.close()


def scene_file(folder, endpoint, extra=""):
    path = folder / "scene.toml"
    path.write_text(f'scene = "dojo"\n{extra}[mesh]\nendpoint = "{endpoint}"\n{OBSERVERS}')
    return path


def step(frame):
    if frame.content == "broken":
        raise BadInput("camera file of 1999")
    return believed()


class OneByOne:
    """A source whose frames the test hands over; None ends it."""

    def __init__(self):
        self._news, self._frames = threading.Condition(), []

    def offer(self, content):
        with self._news:
            self._frames.append(content)
            self._news.notify()

    def frames(self, stop):
        while True:
            with self._news:
                assert self._news.wait_for(lambda: self._frames, SOON_S)
                content = self._frames.pop(0)
            if content is None:
                return
            yield Frame(1, content)


@pytest.fixture
def observing(tmp_path, supervisor):
    """An observer on the mesh, whose frames the test gives."""
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as meeting:
        scene, source, stop = read_scene(scene_file(tmp_path, meeting.locator), {}), OneByOne(), threading.Event()

        def body():
            with pytest.raises(BadInput) if source.shall_break else nullcontext():
                serve_observer(scene, "cam1", FakePipeline(step), source, meeting, stop)

        source.shall_break = False
        thread = threading.Thread(target=body)
        source.start = thread.start
        yield source
        source.offer(None)
        thread.join(SOON_S)
        assert not thread.is_alive()


def test_an_observer_is_ready_before_its_camera_and_alive_with_each_frame(observing, supervisor):
    observing.start()
    supervisor.wait_for("READY=1")
    assert "STATUS=starting" in supervisor.lines and "WATCHDOG=1" not in supervisor.lines
    observing.offer("picture")
    supervisor.wait_for("WATCHDOG=1")
    assert "STATUS=running" in supervisor.lines
    observing.offer(None)
    supervisor.wait_for("STOPPING=1")


def test_an_observer_without_frames_falls_silent_and_says_why(observing, supervisor):
    observing.start()
    observing.offer("picture")
    supervisor.wait_for("WATCHDOG=1")
    before = supervisor.lines.count("WATCHDOG=1")
    supervisor.wait_for("STATUS=degraded: no frame for")
    assert supervisor.lines.count("WATCHDOG=1") == before


def test_an_observer_that_breaks_is_stopping(observing, supervisor):
    observing.shall_break = True
    observing.start()
    observing.offer("broken")
    supervisor.wait_for("STOPPING=1")


def test_fusion_is_ready_while_it_waits_for_a_vocabulary(tmp_path, supervisor):
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as link:
        scene, stop = read_scene(scene_file(tmp_path, link.locator), {}), threading.Event()
        waiting = threading.Thread(target=serve_fusion, args=([scene], "fusion", link, stop))
        waiting.start()
        supervisor.wait_for("READY=1")
        supervisor.wait_for("WATCHDOG=1")
        supervisor.wait_for("WATCHDOG=1")
        stop.set()
        waiting.join(SOON_S)
        assert not waiting.is_alive()


def test_a_hub_is_alive_when_it_hears_something(tmp_path, supervisor):
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as meeting:
        path = scene_file(tmp_path, meeting.locator)
        keys = read_scene(path, {}).keys
        with started("watch", path, "--json") as process:
            supervisor.wait_for("READY=1")
            mouth = meeting.publisher(keys.observer_status("cam1"))
            assert mouth.wait_for_subscriber(SOON_S) and "WATCHDOG=1" not in supervisor.lines
            mouth.put(encode(StatusMessage(scene="dojo", id="cam1", state="running", reason="")))
            supervisor.wait_for("WATCHDOG=1")
            process.send_signal(signal.SIGTERM)
            supervisor.wait_for("STOPPING=1")
            assert process.wait(SOON_S) == 0


def started(*words):
    command = [sys.executable, "-P", "-m", "labanmesh", *map(str, words)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def test_real_processes_speak_with_their_supervisor(tmp_path, supervisor):
    vocabulary = 'vocabulary = ["bowing", "lunging"]\n'
    for words in (
        ("router", "tcp/127.0.0.1:0"),
        ("fuse", scene_file(tmp_path, "tcp/127.0.0.1:0", vocabulary)),
    ):
        with started(*words) as process:
            supervisor.wait_for("READY=1")
            supervisor.wait_for("WATCHDOG=1")
            supervisor.wait_for("WATCHDOG=1")
            process.send_signal(signal.SIGTERM)
            supervisor.wait_for("STOPPING=1")
            assert process.wait(SOON_S) == 0, process.stderr.read()
