"""The notifications of each service to systemd, on a real socket: ready, work done, status, stopping."""

import signal
import socket
import subprocess
from contextlib import suppress
from pathlib import Path
from queue import Queue

import pytest
from mesh_stage import NAMED, FakePipeline, believed
from processes import SOON_S, labanmesh

from common.config import MeshConfig, read_scene
from common.errors import BadInput
from common.messages import StatusMessage
from common.wire import encode
from fusion.server import serve as serve_fusion
from labanmesh_testing.mesh import Mesh, running
from observer.runtime.service import serve as serve_observer
from observer.tracks import Frame

ROOT = Path(__file__).parents[2]
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
    """A source whose frames the test offers; None ends it."""

    def __init__(self):
        self._frames = Queue()
        self.offer = self._frames.put

    def frames(self, stop):
        for content in iter(lambda: self._frames.get(timeout=SOON_S), None):
            yield Frame(1, content)


@pytest.fixture
def mesh():
    opened = Mesh(MeshConfig(endpoint="tcp/127.0.0.1:0"))
    yield opened
    opened.close()


@pytest.fixture
def observing(tmp_path, supervisor, mesh):
    """An observer on the mesh, whose frames the test gives."""
    scene, source = read_scene(scene_file(tmp_path, mesh.meeting.locator), {}), OneByOne()

    def body(stop):
        # A broken frame ends it with that error.
        with suppress(BadInput):
            serve_observer(scene, "cam1", FakePipeline(step), source, mesh.meeting, stop)

    with running(body):
        yield source
        source.offer(None)


def test_an_observer_is_ready_before_its_camera_and_alive_with_each_frame(observing, supervisor):
    supervisor.wait_for("READY=1")
    assert "STATUS=starting" in supervisor.lines and "WATCHDOG=1" not in supervisor.lines
    observing.offer("picture")
    supervisor.wait_for("WATCHDOG=1")
    assert "STATUS=running" in supervisor.lines
    before = supervisor.lines.count("WATCHDOG=1")
    supervisor.wait_for("STATUS=degraded: no frame for")
    assert supervisor.lines.count("WATCHDOG=1") == before
    observing.offer(None)
    supervisor.wait_for("STOPPING=1")


def test_an_observer_that_fails_is_stopping(observing, supervisor):
    observing.offer("broken")
    supervisor.wait_for("STOPPING=1")


def test_fusion_is_ready_while_it_waits_for_a_vocabulary(tmp_path, supervisor, mesh):
    scene = read_scene(scene_file(tmp_path, mesh.meeting.locator), {})
    with running(serve_fusion, [scene], "fusion", mesh.meeting):
        supervisor.wait_for("READY=1")
        supervisor.wait_for("WATCHDOG=1")
        supervisor.wait_for("WATCHDOG=1")


def test_a_hub_is_alive_when_it_receives_a_message(tmp_path, supervisor, mesh):
    path = scene_file(tmp_path, mesh.meeting.locator)
    with started("watch", path, "--json") as process:
        supervisor.wait_for("READY=1")
        publisher = mesh.meeting.publisher(read_scene(path, {}).keys.observer_status("cam1"))
        assert publisher.wait_for_subscriber(SOON_S) and "WATCHDOG=1" not in supervisor.lines
        publisher.put(encode(StatusMessage(scene="dojo", id="cam1", state="running", reason="")))
        supervisor.wait_for("WATCHDOG=1")
        process.send_signal(signal.SIGTERM)
        supervisor.wait_for("STOPPING=1")
        assert process.wait(SOON_S) == 0


def started(*words):
    return subprocess.Popen(labanmesh(*words), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


@pytest.mark.parametrize("verb", ["router", "fuse"])
def test_a_process_notifies_its_supervisor(tmp_path, supervisor, verb):
    endpoint = "tcp/127.0.0.1:0"
    with started(verb, endpoint if verb == "router" else scene_file(tmp_path, endpoint, NAMED)) as process:
        supervisor.wait_for("READY=1")
        supervisor.wait_for("WATCHDOG=1")
        supervisor.wait_for("WATCHDOG=1")
        process.send_signal(signal.SIGTERM)
        supervisor.wait_for("STOPPING=1")
        assert process.wait(SOON_S) == 0, process.stderr.read()
