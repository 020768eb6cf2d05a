"""The app of Home Assistant as a process: a SIMULATED supervisor, a real mosquitto with a password, a real router."""

import signal
import subprocess
import sys

import pytest
from app_stage import RUN, TOKEN, Supervisor, app_folders, simulated_supervisor, write_options
from mqtt_stage import Broker, Listener, mosquitto
from played_scene import LABELS, ROOT, PlayedScene
from processes import SOON_S, until

from common.config import MeshConfig
from common.link import Link


@pytest.fixture
def supervisor():
    with simulated_supervisor() as address:
        yield address


@pytest.fixture
def root(tmp_path):
    return app_folders(tmp_path / "root")


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
    assert "waiting for the MQTT broker" in log and token not in log and "s3cret" not in log, log
    assert ((root / "data/mqtt-password").stat().st_mode & 0o777) == 0o600
    put = {file.name for file in (root / "homeassistant/blueprints/automation/labanmesh").iterdir()}
    assert put == {file.name for file in (ROOT / "deploy/home-assistant/blueprints/automation/labanmesh").iterdir()}
