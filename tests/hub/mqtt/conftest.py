"""A broker, a listener at it, and hubs for a played scene."""

import pytest
from mqtt_stage import Broker, Hub, Listener, mosquitto
from played_scene import PlayedScene, hub_section


@pytest.fixture
def broker(tmp_path):
    """A mosquitto on a free port."""
    if not mosquitto():
        pytest.skip("mosquitto is not installed: tests/hub/mqtt/install_mosquitto.sh")
    with Broker(tmp_path / "broker") as running:
        yield running


@pytest.fixture
def room():
    """A played scene on a mesh of its own."""
    with PlayedScene() as scene:
        yield scene


@pytest.fixture
def listener(broker):
    """A client that receives everything from the broker."""
    with Listener(broker.port) as client:
        yield client


@pytest.fixture
def hub(broker, room, tmp_path):
    """Starts `labanmesh hub mqtt` for the room; more keys go into [hub.mqtt]."""
    hubs = []

    def start(**keys):
        hubs.append(Hub(room.scene_file(tmp_path / "room.toml", hub_section(broker.port, **keys))))
        return hubs[-1]

    yield start
    for each in hubs:
        each.end()
