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


def automate(house, name, blueprint, movement, **more):
    """An automation from a blueprint, with a movement that the editor offers."""
    picked = house.home.offered("room")[movement.replace("_", " ")]
    use = {"path": f"labanmesh/{blueprint}.yaml", "input": {"movement": [picked], **more}}
    house.home.save_automation(name, {"use_blueprint": use})


def perform(house, label):
    house.room.publish_verdict(label, next(NUMBERS), ended=True)


def repeat(house, *counted):
    """A movement is repeated; yields after each repetition what it is counted as."""
    number, how = next(NUMBERS), house.room.how
    house.room.publish_verdict("byebye", number)
    for done, words in enumerate(counted, 1):
        house.room.how = {**how, "repetitions": done}
        yield words
    house.room.publish_verdict("byebye", number, ended=True)
    house.room.how = how


def ran(house, name):
    return house.home.attributes(f"automation.{name}")["last_triggered"]


def test_home_assistant_finds_every_blueprint_valid_and_offers_every_movement(home):
    (known,) = home.home.send({"type": "blueprint/list", "domain": "automation"})
    ours = {path: entry for path, entry in known.items() if path.startswith("labanmesh/")}
    assert set(ours) == {str(file.relative_to(FOLDER)) for file in BLUEPRINTS}
    for entry in ours.values():
        inputs = set(entry["metadata"]["input"])
        assert "error" not in entry and (not inputs & {"movement"} or inputs >= {"certainty", "after", "before"})
    until(lambda: set(home.home.offered("room")) == set(LABELS), lambda: home.home.offered("room"))


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


def test_somebody_who_has_fallen_raises_an_alarm_that_ends_when_they_are_up(home):
    def automation(name, **inputs):
        use = {"path": "labanmesh/somebody_has_fallen.yaml", "input": {"fallen": "binary_sensor.room_fallen", **inputs}}
        home.home.save_automation(name, {"use_blueprint": use})

    def turn(to, name):
        return [{"service": f"input_boolean.turn_{to}", "target": {"entity_id": f"input_boolean.{name}"}}]

    automation("fallen", action=turn("on", "alarm"), up_again=turn("off", "alarm"))
    automation("still_lying", action=turn("on", "late"), up_again=turn("on", "late"), still=600)
    home.room.fall("up", 0)
    home.home.wait_for_state("binary_sensor.room_fallen", "off")
    home.room.fall("fallen")
    home.home.wait_for_state("input_boolean.alarm", "on")
    home.room.fall("up")
    home.home.wait_for_state("input_boolean.alarm", "off")
    until(lambda: ran(home, "still_lying"), "it looks whether there was an alarm")
    assert home.home.state("input_boolean.late") == "off", "nobody has lain for ten minutes"


def test_how_often_a_movement_was_repeated_is_said(home):
    home.room.repeat("byebye")
    home.home.wait_for_state("sensor.room_byebye_count", "0")
    write = {"service": "input_text.set_value"}
    for name, every in (("each", 1), ("third", 3)):
        action = [{**write, "target": {"entity_id": f"input_text.{name}"}, "data": {"value": "{{ words }}"}}]
        inputs = {"count": "sensor.room_byebye_count", "every": every, "action": action}
        home.home.save_automation(name, {"use_blueprint": {"path": "labanmesh/say_how_many.yaml", "input": inputs}})
    for words in repeat(home, "1", "2", "3"):
        home.home.wait_for_state("input_text.each", words)
    home.home.wait_for_state("sensor.room_byebye_count", "3")
    home.home.wait_for_state("input_text.third", "3")
    home.home.call("number", "set_value", entity_id="number.room_byebye_target", value=2)
    home.home.wait_for_state("sensor.room_byebye_count", "0")
    for words in repeat(home, "1 of 2", "2 of 2", "1 of 2"):
        home.home.wait_for_state("input_text.each", words)
    home.home.wait_for_state("input_text.third", "2 of 2")  # the target is said


def test_a_taught_movement_is_offered_at_once_and_a_forgotten_one_not(home):
    home.room.teach(("wave_both_hands", "maestro", "byebye", "nthrow"))
    until(
        lambda: set(home.home.offered("room")) == {"wave both hands", "maestro", "byebye", "nthrow"},
        lambda: home.home.offered("room"),
    )
    automate(home, "taught", "gesture_toggle", "wave_both_hands", target={"entity_id": "light.lamp"})
    before = home.home.state("light.lamp")
    perform(home, "wave_both_hands")
    until(lambda: home.home.state("light.lamp") != before, "the lamp")
    event = home.home.attributes("event.room_verdict")
    assert event["event_type"] == "wave_both_hands" and "ok" not in event["event_types"]
    home.room.teach(LABELS)
    until(lambda: "ok" in home.home.offered("room"), lambda: home.home.offered("room"))
    perform(home, "ok")
    home.home.wait_for_state("light.lamp", before)
