"""Counters for Home Assistant: discovery, live counts, targets with their event, reset, and another vocabulary."""

import json
import signal
import time

import pytest
from played_scene import scene_of

from common.message_types import MovementTimes
from hub.mqtt.bridge import SceneBridge
from hub.mqtt.entities import Topics
from hub.scene_state import SceneState

TOPICS = Topics("room", "labanmesh/room/bridge")


def repeated(make, *labels):
    vocabulary = make.vocabulary()
    return vocabulary.model_copy(update={"movements": {each: MovementTimes(period_s=1.0) for each in labels}})


class Stage:
    def __init__(self, make, *labels, left=()):
        self.make, self.bridge, self.at_s = make, SceneBridge(scene_of(), TOPICS.bridge), 0.0
        for topic in left:
            self.bridge.note_left(topic, left[topic])
        self.bridge.recall(None)
        self.state = SceneState("room").fold(repeated(make, *labels), make.NOON)
        self.retained = {}
        self.show(make.judgement())

    def show(self, message):
        self.at_s += 1.0
        at_ns = self.make.NOON + int(self.at_s * self.make.SECOND)
        self.state = self.state.fold(message, at_ns).at(at_ns)
        for each in self.bridge.due_states(self.state, frozenset(), self.at_s):
            self.retained[each.topic] = each.payload
        events = []
        while (event := self.bridge.next_event(self.at_s)) is not None:
            self.bridge.confirm_event()
            events.append(event)
        return [json.loads(each.payload) for each in events if each.topic == TOPICS.of("target")]

    def count(self, done, number=1):
        return self.show(self.make.moving(1 + done, number, "ok", self.make.NOON + done, repetitions=done))

    @property
    def counted(self):
        return json.loads(self.retained[TOPICS.count("ok")])


@pytest.fixture
def stage(make):
    return Stage(make, "ok")


def test_a_repeated_movement_has_a_sensor_a_target_and_a_reset(stage):
    found = {topic: json.loads(text) for topic, text in stage.retained.items() if "_ok/config" in topic}
    kinds = {topic.split("/")[1] for topic in found}
    assert kinds >= {"sensor", "number", "button"}
    (number,) = (each for topic, each in found.items() if "/number/" in topic)
    assert number["command_topic"] == "labanmesh/room/count/ok/target" and number["name"] == "Ok target"
    assert not any("COUNT_nthrow" in topic for topic in stage.retained), "it is no repeated movement"


def test_reset_and_commands_that_are_none(stage):
    stage.count(4)
    obey = stage.bridge.counters.obey
    assert obey("labanmesh/room/count/ok/reset", b"PRESS")
    stage.count(5)
    assert stage.counted["count"] == 1
    assert not obey("labanmesh/room/count/other/reset", b"") and not obey("homeassistant/status", b"online")
    for payload in (b"many", b"-1", b"nan", b"inf", b"1e9", None):
        obey("labanmesh/room/count/ok/target", payload)
    stage.count(6)
    assert stage.counted["target"] == 0 and stage.counted["count"] == 2


LEFT = ["", "{}", "[]", '{"target": true}', '{"target": 1e9}', '{"target": "3"}', "[" * 9999, None]


@pytest.mark.parametrize("left", LEFT)
def test_a_retained_state_that_is_none_is_no_target(make, left):
    stage = Stage(make, "ok", left={TOPICS.count("ok"): left})
    assert stage.counted["target"] == 0


def test_what_the_vocabulary_does_not_have_any_more_is_removed(make, stage):
    stage.show(repeated(make, "nthrow"))
    assert stage.retained[TOPICS.count("ok")] == "" and stage.retained[TOPICS.config("sensor", "COUNT", "ok")] == ""
    assert json.loads(stage.retained[TOPICS.count("nthrow")])["count"] == 0


def test_at_a_real_broker_a_set_is_counted_its_target_said_and_kept_over_a_restart_of_the_hub(room, hub, listener):
    count, target = "labanmesh/room/count/ok", "homeassistant/number/labanmesh_room_TARGET_ok/config"
    room.repeat("ok")
    first = hub().connected()
    room.wait_for_hub()
    listener.wait_for(lambda: target in listener.last and count in listener.last)
    listener.publish(json.loads(listener.last[target])["command_topic"], "3")
    listener.wait_for(lambda: json.loads(listener.last[count])["target"] == 3)
    began_ns = time.time_ns()
    for done in (1, 2, 3):
        room.how = {"repetitions": done, "partial_repetitions": 1}
        if done != 2:
            room.publish_verdict("ok", 1, ended=done == 3, began_ns=began_ns)
        listener.wait_for(lambda done=done: json.loads(listener.last[count])["count"] == done)
    listener.wait_for(lambda: listener.events("labanmesh/room/target"))
    (event,) = listener.events("labanmesh/room/target")
    assert (event["event_type"], event["count"], event["partial"], event["sets"]) == ("ok", 3, 1, 1)

    first.end(signal.SIGKILL)
    listener.wait_for_state("labanmesh/room/bridge", "offline")
    hub().connected()
    listener.wait_for(lambda: json.loads(listener.last[count])["count"] == 0)
    assert json.loads(listener.last[count]) == {"count": 0, "partial": 0, "target": 3, "sets": 0}
    room.publish_verdict("ok", 2, ended=True, began_ns=time.time_ns())
    listener.wait_for(lambda: len(listener.events("labanmesh/room/target")) == 2)
    listener.publish(f"{count}/reset", "PRESS")
    listener.wait_for(lambda: json.loads(listener.last[count])["count"] == 0)
    assert json.loads(listener.last[count])["target"] == 3
