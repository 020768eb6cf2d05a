"""A real Home Assistant: entities, events, states over restarts, and a dead observer."""

import signal
import time
from itertools import permutations

import pytest
from played_scene import LABELS
from processes import until

ORDERS = list(permutations(("home", "broker", "hub")))
SCENE = {"event.room_verdict", "event.room_movement_ended", "sensor.room_movement", "sensor.room_confidence",
         "sensor.room_entropy", "sensor.room_last_verdict", "binary_sensor.room_nthrow",
         "binary_sensor.room_maestro", "event.room_early_word", "sensor.room_effort_time",
         "sensor.room_facing", "sensor.room_last_event", "binary_sensor.room_fallen",
         "sensor.room_posture"}  # fmt: skip
OBSERVER = {"binary_sensor.room_{}_connected"} | {
    f"sensor.room_{{}}_{what}"
    for what in (
        "opinion",
        "state",
        "entropy",
        "weight",
        "reliability",
        "age",
        "rate",
        "clock_skew",
        "rejected_messages",
    )
}
ALL = SCENE | {entity.format(observer) for entity in OBSERVER for observer in ("cam1", "cam2")}


def test_all_entities_appear_and_are_available(house):
    until(lambda: set(house.home.states()) >= ALL, lambda: f"missing: {ALL - set(house.home.states())}")
    until(lambda: not unavailable(house), lambda: f"unavailable: {unavailable(house)}")
    assert set(house.home.states()) == ALL
    event = house.home.states()["event.room_verdict"]
    assert event["attributes"]["event_types"] == [*LABELS, "abstain"] and event["state"] == "unknown"
    assert house.home.state("sensor.room_movement") == "rest" and house.home.state("sensor.room_confidence") == "90"


def unavailable(house):
    return {name for name, each in house.home.states().items() if each["state"] == "unavailable"}


def test_a_verdict_arrives_as_an_event(house):
    began_s = time.monotonic()
    house.room.publish_verdict("nthrow", 1)
    until(
        lambda: event_type(house, "event.room_verdict") == "nthrow", lambda: house.home.states()["event.room_verdict"]
    )
    print(f"a verdict was an event of Home Assistant after {time.monotonic() - began_s:.2f} s")
    house.home.wait_for_state("binary_sensor.room_nthrow", "on")
    house.home.wait_for_state("sensor.room_movement", "nthrow")
    attributes = house.home.states()["event.room_verdict"]["attributes"]
    assert attributes["stage"] == "decided" and attributes["votes"]["cam1"]["label"] == "nthrow"
    assert house.home.states()["sensor.room_movement"]["attributes"]["votes"]["cam2"]["state"] == "counted"
    house.room.publish_verdict("nthrow", 1, ended=True)
    house.home.wait_for_state("binary_sensor.room_nthrow", "off")
    until(lambda: event_type(house, "event.room_movement_ended") == "nthrow", "the end")


def test_an_early_word_is_an_event_and_a_facet_is_a_state(house):
    def early():
        attributes = house.home.states()["event.room_early_word"]["attributes"]
        return tuple(attributes.get(each) for each in ("event_type", "stage", "early", "id"))

    house.room.doubts = True
    house.home.wait_for_state("sensor.room_confidence", "40")
    house.room.begin(2)
    until(lambda: early() == ("byebye", "early", "byebye", "room-2"), early)
    house.room.publish_verdict("ok", 2, ended=True)
    until(lambda: early() == ("ok", "corrected", "byebye", "room-2"), early)
    again = "automation.lights_off_on_byebye_and_on_again_if_it_was_none"
    until(lambda: house.home.attributes(again)["last_triggered"], "the automation that acts early")
    states = house.home.states()
    assert (states["sensor.room_facing"]["state"], states["sensor.room_effort_time"]["state"]) == ("45", "sudden")
    assert states["sensor.room_effort_time"]["attributes"]["probability"] == 80
    how_before, house.room.how = house.room.how, {}
    house.home.wait_for_state("sensor.room_effort_time", "unknown")
    house.home.wait_for_state("sensor.room_facing", "unknown")
    house.room.how, house.room.doubts = how_before, False
    house.home.wait_for_state("sensor.room_confidence", "90")


def test_the_automation_of_the_document_runs_for_its_movement_alone(house):
    def ran():
        return house.home.attributes("automation.lights_off_on_byebye")["last_triggered"]

    until(lambda: set(house.home.states()) == ALL and not unavailable(house), lambda: house.home.states())
    for number, label in enumerate(("ok", "byebye"), start=5):
        assert ran() is None
        house.room.publish_verdict(label, number, ended=True)
        until(lambda label=label: event_type(house, "event.room_verdict") == label, label)
    until(ran, "the automation")


def test_a_correction_runs_the_automation_that_takes_its_action_back(house):
    def triggered(name):
        return house.home.attributes(f"automation.{name}")["last_triggered"]

    until(lambda: set(house.home.states()) == ALL and not unavailable(house), lambda: house.home.states())
    quick, careful = "lights_off_on_byebye_and_on_again_if_it_is_corrected", "lights_off_on_byebye"
    before = {name: triggered(name) for name in (quick, careful)}
    house.room.publish_verdict("byebye", 11)
    until(lambda: all(triggered(name) != at for name, at in before.items()), "both automations act on the first word")
    first, careful_at = triggered(quick), triggered(careful)
    house.room.publish_verdict("ok", 11, stage="revised", revises="byebye")
    until(lambda: triggered(quick) != first, "the action is taken back")
    attributes = house.home.states()["event.room_verdict"]["attributes"]
    assert (attributes["stage"], attributes["revises"], attributes["id"]) == ("revised", "byebye", "room-11")
    until(lambda: house.home.states()["sensor.room_movement"]["attributes"]["revises"] == "byebye", "the attributes")
    taken_back = triggered(quick)
    house.room.publish_verdict("ok", 11, ended=True, revises="byebye")
    until(lambda: event_type(house, "event.room_movement_ended") == "ok", "the end")
    assert (triggered(quick), triggered(careful)) == (taken_back, careful_at), "the end runs nothing"


def event_type(house, event):
    return house.home.states()[event]["attributes"].get("event_type")


def test_without_observers_the_movement_is_unknown(house):
    house.room.silent = frozenset(house.room.observers)
    for entity in ("sensor.room_movement", "sensor.room_confidence", "sensor.room_entropy"):
        house.home.wait_for_state(entity, "unknown")
    house.room.silent = frozenset()
    house.home.wait_for_state("sensor.room_movement", "rest")


def test_devices_hang_together(house):
    devices = house.home.devices()
    scene, observer = devices["room"], devices["room cam1"]
    assert observer["via_device_id"] == scene["id"] and set(devices) == {"room", "room cam1", "room cam2"}


@pytest.mark.parametrize("order", ORDERS, ids="-".join)
def test_states_survive_a_restart_of_each(house, order):
    until(lambda: set(house.home.states()) == ALL and not unavailable(house), lambda: house.home.states())
    number = 20 + ORDERS.index(order)  # no id is used twice
    house.room.publish_verdict("maestro", number)
    house.home.wait_for_state("binary_sensor.room_maestro", "on")
    until(lambda: event_type(house, "event.room_verdict") == "maestro", "the verdict")
    fired = house.home.state("event.room_verdict")
    for part in order:
        house.restart(part)
        until(lambda: as_before(house, fired), lambda part=part: f"after {part}: {house.home.states()}")
    house.room.publish_verdict("maestro", number, ended=True)
    house.home.wait_for_state("binary_sensor.room_maestro", "off")
    assert house.home.state("event.room_verdict") == fired, "a restart is no verdict"


def as_before(house, fired):
    states = {name: each["state"] for name, each in house.home.states().items()}
    movements = states.get("sensor.room_movement"), states.get("sensor.room_last_verdict")
    wanted = {"binary_sensor.room_maestro": "on", "binary_sensor.room_nthrow": "off", "event.room_verdict": fired}
    return set(states) == ALL and not unavailable(house) and movements == ("maestro", "maestro") and (
        wanted.items() <= states.items()
    )  # fmt: skip


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_dead_observer_is_unavailable_within_two_seconds(house, number):
    house.room.silent = frozenset({"cam1"})
    house.home.wait_for_state("sensor.room_cam1_state", "unavailable")
    process = house.room.observer("cam1")
    house.home.wait_for_state("sensor.room_cam1_state", "running")
    house.home.wait_for_state("binary_sensor.room_cam1_connected", "on")
    began_s = time.monotonic()
    process.send_signal(number)
    house.home.wait_for_state("sensor.room_cam1_state", "unavailable", 2.0)
    house.home.wait_for_state("binary_sensor.room_cam1_connected", "off", 2.0 - (time.monotonic() - began_s))
    print(f"{number.name}: unavailable after {time.monotonic() - began_s:.2f} s")
    assert house.home.state("sensor.room_cam2_opinion") not in ("unavailable", None)
    process.kill()
    process.wait()
    house.room.silent = frozenset()


def test_a_scene_without_fusion_is_unavailable_and_can_be_deleted(house):
    house.room.stop_judging()
    house.home.wait_for_state("sensor.room_movement", "unavailable", 3.0)
    house.delete_scene()
    until(lambda: not house.home.states(), lambda: house.home.states())
