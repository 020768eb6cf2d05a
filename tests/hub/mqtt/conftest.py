"""A broker, a mesh on which somebody judges, and a listener at the broker."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))

from mqtt_stage import Broker, Hub, Listener, Room, mosquitto


@pytest.fixture
def broker(tmp_path):
    """A mosquitto on a free port."""
    if not mosquitto():
        pytest.skip("mosquitto is not installed: tests/hub/mqtt/install_mosquitto.sh")
    with Broker(tmp_path / "broker") as running:
        yield running


@pytest.fixture
def room():
    """A scene that is judged, on a mesh of its own."""
    with Room() as judged:
        yield judged


@pytest.fixture
def listener(broker):
    """Who hears all that the broker has."""
    with Listener(broker.port) as ear:
        yield ear


@pytest.fixture
def hub(broker, room, tmp_path):
    """Starts `labanmesh hub mqtt` for the room; more lines go into [hub.mqtt]."""
    started = []

    def start(*words, **keys):
        file = room.scene_file(tmp_path / f"{room.name}.toml", broker.port, **keys)
        started.append(Hub(file, *words))
        return started[-1]

    yield start
    for each in started:
        each.end()
