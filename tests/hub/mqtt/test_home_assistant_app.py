"""The run script of the Home Assistant app: a SIMULATED supervisor, a real mosquitto with a password, a real router."""

import http.server
import importlib.util
import json
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from mqtt_stage import Broker, Listener, mosquitto
from played_scene import LABELS, ROOT, SOON_S, PlayedScene, until

from common.config import MeshConfig
from common.link import Link

RUN = ROOT / "deploy" / "home-assistant" / "labanmesh" / "run.py"
TOKEN = "given by the supervisor"  # noqa: S105 - of the simulation


class Supervisor(http.server.BaseHTTPRequestHandler):
    """Answers one question of the app; the broker is in `service`, None: it is not known yet."""

    service = None
    asked = 0

    def do_GET(self):
        type(self).asked += 1
        assert self.path == "/services/mqtt" and self.headers["Authorization"] == f"Bearer {TOKEN}"
        found = self.service is not None
        body = (
            {"result": "ok", "data": self.service} if found else {"result": "error", "message": "Service not enabled"}
        )
        self.send_response(200 if found else 400)
        self.end_headers()
        self.wfile.write(json.dumps(body).encode())

    def log_message(self, *_):
        pass


@pytest.fixture
def supervisor():
    """Its address; `Supervisor` says what it knows."""
    Supervisor.service, Supervisor.asked = None, 0
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Supervisor) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.fixture
def root(tmp_path):
    """The folders of an app: /data, /config, /homeassistant."""
    for folder in ("data", "config", "homeassistant"):
        (tmp_path / "root" / folder).mkdir(parents=True)
    return tmp_path / "root"


def write_options(root, **options):
    (root / "data/options.json").write_text(json.dumps({"scene": "room", "cameras": [], "blueprints": True, **options}))


@pytest.fixture
def broker(tmp_path):
    """A mosquitto that admits one user."""
    if not mosquitto():
        pytest.skip("mosquitto is not installed: tests/hub/mqtt/install_mosquitto.sh")
    place = tmp_path / "broker"
    place.mkdir()
    subprocess.run(
        ["mosquitto_passwd", "-b", "-c", place / "passwords", "addons", "s3cret"], check=True, timeout=SOON_S
    )
    lines = ["allow_anonymous true", f"password_file {place / 'passwords'}"]
    with Broker(place, lines) as running:
        yield running


@pytest.fixture
def room():
    """A played scene in a real Zenoh router."""
    mesh = MeshConfig(mode="router", endpoint="tcp/127.0.0.1:0")
    with Link.open(mesh, "router") as link, PlayedScene(link=link) as scene:
        yield scene


def test_the_app_brings_a_scene_of_other_computers_to_the_broker_that_the_supervisor_names(
    root, supervisor, broker, room
):
    write_options(root, router=room.endpoint, cameras=[{"name": "cam1"}, {"name": "cam2"}])
    bare = {"PATH": "/usr/bin:/bin", "PYTHONPATH": str(ROOT), "SUPERVISOR_TOKEN": TOKEN}
    bare |= {"LABANMESH_HUB_DASHBOARD_LISTEN": "127.0.0.1:0"}
    command = [sys.executable, "-P", RUN, root, supervisor]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with Listener(broker.port) as listener, subprocess.Popen(command, env=bare, cwd=root, **pipes) as app:
        try:
            until(lambda: Supervisor.asked, "the app asks the supervisor")
            service = {"host": "127.0.0.1", "port": broker.port, "ssl": False, "protocol": "3.1.1"}
            Supervisor.service = {**service, "username": "addons", "password": "s3cret", "addon": "core_mosquitto"}
            for label in LABELS:
                topic = f"homeassistant/device_automation/labanmesh_room_RECOGNISED_{label}/config"
                listener.wait_for(lambda topic=topic: topic in listener.last)
            room.publish_verdict("ok", 1)
            listener.wait_for(lambda: "labanmesh/room/verdict" in listener.last)
        finally:
            app.send_signal(signal.SIGTERM)
            log, _ = app.communicate(timeout=SOON_S)
    assert app.returncode == 0, log
    token = (root / "config/token.txt").read_text().strip()
    assert "waiting for the MQTT broker" in log and f"token: {token}" in log and "s3cret" not in log, log
    assert ((root / "data/mqtt-password").stat().st_mode & 0o777) == 0o600
    put = {file.name for file in (root / "homeassistant/blueprints/automation/labanmesh").iterdir()}
    assert put == {file.name for file in (ROOT / "deploy/home-assistant/blueprints/automation/labanmesh").iterdir()}


@pytest.fixture(scope="module")
def run():
    """The run script as a module."""
    spec = importlib.util.spec_from_file_location("labanmesh_app", RUN)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({}, "no camera: add one to the options, or put a scene file of your own"),
        ({"router": "tls/attic:7447", "certificates": "mine"}, "certificates: no folder 'mine' in the app's folder"),
        ({"cameras": [{"name": "a", "source": "0"}, {"name": "a", "source": "1"}]}, "cameras: two are called 'a'"),
    ],
)
def test_options_that_cannot_work_are_one_line(run, root, capsys, options, line):
    write_options(root, mqtt_host="broker.local", mqtt_username="anna", **options)
    assert run.main(root, "http://127.0.0.1:1") == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and line in error


def test_without_a_router_everything_runs_here_and_an_own_scene_file_goes_first(run, root, capsys, monkeypatch):
    started = {}

    class Recorded:
        def __init__(self, jobs, environment):
            started.update({job.name: job.command for job in jobs}, environment=environment)

        def run(self, stop):
            return 0

    monkeypatch.setattr(run, "Launcher", Recorded)
    write_options(
        root, mqtt_host="broker.local", cameras=[{"name": "sofa", "source": 'rtsp://a"b/ä'}, {"name": "shelf"}]
    )
    assert run.main(root, "") == 0
    assert set(started) == {"[fuse]", "sofa", "shelf", "[mqtt]", "[dashboard]", "environment"}
    made = run.read_scene(root / "data/scene.toml", started["environment"])
    assert made.observer("sofa").source == 'rtsp://a"b/ä' and made.hub.mqtt.host == "broker.local"
    assert made.taught_model("sofa").parent == root / "config/models" and made.hub.mqtt.movements == ("*",)
    (root / "config/scene.toml").write_text('scene = "mine"\n[observers.door]\nsource = "0"\n')
    started.clear()
    assert run.main(root, "") == 0 and "door" in started and "sofa" not in started
    assert str(root / "config/scene.toml") in started["[mqtt]"]


def test_the_app_has_the_version_of_labanmesh():
    version = re.search(r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text("utf-8"), re.MULTILINE)[1]
    assert f'\nversion: "{version}"\n' in (RUN.parent / "config.yaml").read_text("utf-8")
    assert Path(RUN).name in (RUN.parent / "Dockerfile").read_text("utf-8")
