"""The blueprints in a real Home Assistant: imported, made into automations as its editor does, and run by verdicts."""

import itertools
import json

import pytest
from mqtt_stage import Listener
from played_scene import LABELS, ROOT
from processes import until

FOLDER = ROOT / "deploy" / "home-assistant" / "blueprints" / "automation"
BLUEPRINTS = sorted(FOLDER.rglob("*.yaml"))
LAMP = {"name": "Lamp", "unique_id": "lamp", "object_id": "lamp", "command_topic": "lamp/set"}
NUMBERS = itertools.count(1)


@pytest.fixture(scope="module")
def home(house):
    """The house with a lamp and all blueprints."""
    saved = [
        {
            "type": "blueprint/save",
            "domain": "automation",
            "path": str(file.relative_to(FOLDER)),
            "yaml": file.read_text(),
        }
        for file in BLUEPRINTS
    ]
    house.home.send(*saved)
    with Listener(house.broker.port, "lamp/set") as lamp:
        lamp.client.publish("homeassistant/light/lamp/config", json.dumps(LAMP), retain=True)
        house.home.wait_for_state("light.lamp", "unknown")
        yield house


def offered(house):
    """What the editor offers as triggers of the device `room`, by the movement."""
    (devices,) = house.home.send({"type": "config/device_registry/list"})
    (room,) = [device for device in devices if device["name"] == "room"]
    (triggers,) = house.home.send({"type": "device_automation/trigger/list", "device_id": room["id"]})
    return {each["subtype"]: each for each in triggers if each.get("type") == "recognised"}


def automate(house, name, blueprint, movement, **more):
    """An automation from a blueprint, with a movement that the editor offers."""
    picked = offered(house)[movement.replace("_", " ")]
    use = {"path": f"labanmesh/{blueprint}.yaml", "input": {"movement": [picked], **more}}
    house.home.save_automation(name, {"use_blueprint": use})


def perform(house, label):
    house.room.publish_verdict(label, next(NUMBERS), ended=True)


def ran(house, name):
    return house.home.attributes(f"automation.{name}")["last_triggered"]


def test_home_assistant_finds_every_blueprint_valid_and_offers_every_movement(home):
    (known,) = home.home.send({"type": "blueprint/list", "domain": "automation"})
    ours = {path: entry for path, entry in known.items() if path.startswith("labanmesh/")}
    assert set(ours) == {str(file.relative_to(FOLDER)) for file in BLUEPRINTS}
    for entry in ours.values():
        assert "error" not in entry and set(entry["metadata"]["input"]) >= {"movement", "certainty", "after", "before"}
    until(lambda: set(offered(home)) == set(LABELS), lambda: offered(home))


def test_a_movement_switches_a_lamp_on_and_off_and_activates_a_scene(home):
    lamp = {"target": {"entity_id": "light.lamp"}}
    automate(home, "toggle", "gesture_toggle", "ok", **lamp)
    automate(home, "doubtful", "gesture_toggle", "ok", certainty=95, **lamp)
    automate(home, "never_now", "gesture_toggle", "ok", after="00:00:00", before="00:00:01", **lamp)
    automate(home, "cinema", "gesture_scene", "maestro", scene="scene.cinema")
    for label, state in (("ok", "on"), ("ok", "off")):
        perform(home, label)
        home.home.wait_for_state("light.lamp", state)
    perform(home, "maestro")
    home.home.wait_for_state("input_boolean.curtain", "on")
    assert ran(home, "toggle") and not ran(home, "doubtful") and not ran(home, "never_now")
    assert home.home.state("light.lamp") == "off"


def test_a_repeated_movement_runs_a_script_and_one_alone_does_not(home):
    call = [{"service": "input_boolean.turn_on", "target": {"entity_id": "input_boolean.called"}}]
    automate(home, "twice", "gesture_twice", "byebye", action=call, seconds=20)
    automate(
        home,
        "once",
        "gesture_action",
        "byebye",
        action=[{"service": "light.turn_on", "target": {"entity_id": "light.lamp"}}],
    )
    perform(home, "byebye")
    home.home.wait_for_state("light.lamp", "on")
    until(lambda: home.home.attributes("automation.twice")["current"] == 1, "it waits for the second time")
    assert home.home.state("input_boolean.called") == "off"
    perform(home, "byebye")
    home.home.wait_for_state("input_boolean.called", "on")


def test_a_taught_movement_is_offered_at_once_and_a_forgotten_one_not(home):
    home.room.teach(("wave_both_hands", "maestro", "byebye", "nthrow"))
    until(lambda: set(offered(home)) == {"wave both hands", "maestro", "byebye", "nthrow"}, lambda: offered(home))
    automate(home, "taught", "gesture_toggle", "wave_both_hands", target={"entity_id": "light.lamp"})
    before = home.home.state("light.lamp")
    perform(home, "wave_both_hands")
    until(lambda: home.home.state("light.lamp") != before, "the lamp")
    event = home.home.attributes("event.room_verdict")
    assert event["event_type"] == "wave_both_hands" and "ok" not in event["event_types"]
    home.room.teach(LABELS)
    until(lambda: "ok" in offered(home), lambda: offered(home))
    perform(home, "ok")
    home.home.wait_for_state("light.lamp", before)
