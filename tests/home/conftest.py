"""A real Home Assistant (LABANMESH_HASS), a broker, a scene that is judged, and the hub between them."""

import os
import re
import sys
from pathlib import Path

import pytest

sys.path += [str(Path(__file__).parent), str(Path(__file__).parents[1] / "hub" / "mqtt")]

from home_assistant import HomeAssistant
from mqtt_stage import ROOT, SOON_S, Broker, Hub, Room, mosquitto


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    """All of it, running; each part can be restarted."""
    program = os.environ.get("LABANMESH_HASS")
    if not program:
        pytest.skip("LABANMESH_HASS is not set: make test-home brings a Home Assistant")
    if not mosquitto():
        pytest.skip("mosquitto is not installed: tests/hub/mqtt/install_mosquitto.sh")
    place = tmp_path_factory.mktemp("house")
    # The broker keeps nothing over a restart: the hub has to say it again.
    with (
        Broker(place / "broker") as broker,
        Room() as room,
        HomeAssistant(program, place / "home", broker.port, automation()) as home,
    ):
        room.how = {"facets": {"effort_time": [0.2, 0.8]}, "facing_deg": 45.0}
        with House(home, broker, room, place) as whole:
            yield whole


def automation():
    """Those that docs/guide/home.md shows, for the scene of the test."""
    texts = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / "guide" / "home.md").read_text("utf-8"), re.DOTALL)
    return "".join("- " + text.replace("\n", "\n  ").rstrip(" ") for text in texts).replace("dojo", "room")


class House:
    """The parts, and the hub, which is started here."""

    def __init__(self, home, broker, room, place):
        self.home, self.broker, self.room = home, broker, room
        named = {"movements": ["nthrow", "maestro"], "area": "Dojo"}
        self._file = room.scene_file(place / "room.toml", broker.port, certainty=0.85, **named)
        self.hub = Hub(self._file)

    def restart(self, part):
        """One part, in order; it is up again when this returns."""
        if part == "hub":
            assert self.hub.end() == 0, self.hub.log
            self.hub = Hub(self._file).connected()
        else:
            running = {"home": self.home, "broker": self.broker}[part]
            running.stop()
            running.start()

    def take_out(self):
        """Stop the hub, and take the scene out of the broker."""
        assert self.hub.end() == 0, self.hub.log
        self.hub = Hub(self._file, "--remove")
        assert self.hub.process.wait(SOON_S) == 0, self.hub.log

    def __enter__(self):
        self.hub.connected()
        return self

    def __exit__(self, *_):
        self.hub.end()
