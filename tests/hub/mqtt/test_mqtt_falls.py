"""The watch for falls at the broker: the alarm, the posture, and the last event."""

import json

import pytest
from played_scene import fall_of, scene_of

from hub.mqtt.bridge import SceneBridge
from hub.mqtt.entities import Topics, discovery
from hub.scene_state import SceneState

TOPICS = Topics("room", "labanmesh/room/bridge")


class Broker:
    """What a bridge has published last under each topic."""

    def __init__(self):
        self.bridge = SceneBridge(scene_of(watch={"fallen": {}}), TOPICS.bridge)
        self.bridge.recall(None)
        self.state, self.now_s, self.topics = SceneState("room"), 0.0, {}

    def take(self, *messages):
        for message in messages:
            self.state = self.state.fold(message, message.at_ns)
        self.now_s += 2.0
        for publication in self.bridge.due_states(self.state, frozenset(), self.now_s):
            self.topics[publication.topic] = publication.payload
        return {topic.removeprefix("labanmesh/room/"): payload for topic, payload in self.topics.items()}


def test_entities_are_there_only_if_the_scene_watches():
    without = discovery(TOPICS, scene_of(), ("ok",), ())
    assert not any("FALLEN" in topic for topic in without)
    entities = discovery(TOPICS, scene_of(watch={"fallen": {}}), ("ok",), ())
    alarm = json.loads(entities["homeassistant/binary_sensor/labanmesh_room_FALLEN/config"])
    assert alarm["device_class"] == "safety" and alarm["state_topic"] == "labanmesh/room/fallen"
    assert [each["topic"] for each in alarm["availability"]] == [TOPICS.bridge], "an alarm stays when the watch is away"


def test_the_alarm_goes_on_and_off_and_lying_for_a_moment_is_none(make):
    broker = Broker()
    assert "fallen" not in broker.take(fall_of("unknown", id=None, lying=None))
    for stage, payload in (("up", "OFF"), ("low", "OFF"), ("fallen", "ON"), ("up", "OFF")):
        topics = broker.take(fall_of(stage))
        assert topics["fallen"] == payload, stage
    state = json.loads(broker.take(fall_of("fallen"))["fall"])
    assert (state["stage"], state["confidence"], state["agreement"]) == ("fallen", 93, "2 of 3")
    assert broker.take(fall_of("unknown", id=None))["fallen"] == "ON", "a new service knows nothing yet"


@pytest.mark.parametrize("at_s", [-60, 60])
def test_the_last_event_is_the_later_one(make, at_s):
    broker = Broker()
    broker.take(make.judgement(), fall_of(at_ns=make.NOON + at_s * make.SECOND))
    broker.bridge.receive(make.verdict(label="ok"), 1.0)
    event = json.loads(broker.take()["last_event"])
    assert event["event"] == ("fallen" if at_s > 0 else "ok")
    assert (
        json.loads(broker.take(fall_of("up", at_ns=make.NOON + 90 * make.SECOND))["last_event"])["event"] == "up_again"
    )
