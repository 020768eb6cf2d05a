"""A real Home Assistant (LABANMESH_HASS), a broker, a played scene, and the hub between them."""

import os
import re

import pytest
from home_assistant import HomeAssistant
from mqtt_stage import Broker, Hub, mosquitto
from played_scene import ROOT, PlayedScene, hub_section
from processes import SOON_S


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    """All parts, running; each can be restarted."""
    program = os.environ.get("LABANMESH_HASS")
    if not program:
        pytest.skip("LABANMESH_HASS is not set: make test-home brings a Home Assistant")
    if not mosquitto():
        pytest.skip("mosquitto is not installed: tests/hub/mqtt/install_mosquitto.sh")
    place = tmp_path_factory.mktemp("house")
    # The broker keeps nothing over a restart: the hub has to publish it again.
    with (
        Broker(place / "broker") as broker,
        PlayedScene(session="s") as room,
        HomeAssistant(program, place / "home", broker.port, automation()) as home,
    ):
        room.how = {"facets": {"effort_time": [0.2, 0.8]}, "facing_deg": 45.0}
        with House(home, broker, room, place) as whole:
            yield whole


def automation():
    """The automations in docs/guide/home.md, for the scene of the test."""
    texts = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / "guide" / "home.md").read_text("utf-8"), re.DOTALL)
    return "".join("- " + text.replace("\n", "\n  ").rstrip(" ") for text in texts).replace("dojo", "room")


class House:
    """The parts; the hub is started here."""

    def __init__(self, home, broker, room, place):
        self.home, self.broker, self.room = home, broker, room
        keys = {"movements": ["nthrow", "maestro"], "area": "Dojo"}
        sections = "[watch.fallen]\n" + hub_section(broker.port, 0.85, **keys)
        self._file = room.scene_file(place / "room.toml", sections)
        self.hub = Hub(self._file)

    def restart(self, part):
        """Restart one part; it is up again when this returns."""
        if part == "hub":
            assert self.hub.end() == 0, self.hub.log
            self.hub = Hub(self._file).connected()
        else:
            running = {"home": self.home, "broker": self.broker}[part]
            running.stop()
            running.start()

    def delete_scene(self):
        """Stop the hub, and delete the scene from the broker."""
        assert self.hub.end() == 0, self.hub.log
        self.hub = Hub(self._file, "--remove")
        assert self.hub.process.wait(SOON_S) == 0, self.hub.log

    def __enter__(self):
        self.hub.connected()
        return self

    def __exit__(self, *_):
        self.hub.end()
