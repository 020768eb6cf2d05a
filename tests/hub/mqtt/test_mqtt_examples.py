"""The examples for MQTT work, and docs/guide/home.md names every topic and field."""

import json
import re
import shutil
import subprocess
from typing import get_args

import pytest
from mqtt_stage import Listener
from played_scene import ROOT
from processes import SOON_S

from hub.anticipation import EarlyWord
from hub.mqtt.entities import SceneTopic, Topics
from hub.mqtt.events import early_event, verdict_event

SCRIPT = ROOT / "examples" / "mqtt.sh"
FLOW = json.loads((ROOT / "examples" / "node-red-flow.json").read_text("utf-8"))


def test_the_shell_example_prints_each_verdict_and_sigterm_ends_all_of_it(broker, make):
    if not (shutil.which("mosquitto_sub") and shutil.which("jq")):
        pytest.skip("mosquitto_sub or jq is not installed: tests/hub/mqtt/install_mosquitto.sh")
    verdicts = [
        verdict_event(make.verdict(1), "decided"),
        verdict_event(make.verdict(1, label="ok"), "revised"),
        verdict_event(make.verdict(2, label="abstain"), "decided"),
    ]
    command = [SCRIPT, "127.0.0.1", str(broker.port)]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as script,
        Listener(broker.port, "$SYS/broker/log/#") as listener,
    ):
        try:
            broker.wait_for_subscriber("labanmesh/+/verdict")
            for verdict in verdicts:
                listener.publish("labanmesh/room/verdict", json.dumps(verdict))
            assert script.stdout.readline() == "nthrow, 60 % sure, 1 of 2 observers\n"
            assert script.stdout.readline() == "there was a movement, and the observers did not agree which\n"
            script.terminate()
            # Its output ends with the last of its processes.
            assert script.communicate(timeout=SOON_S) == ("", None)
        finally:
            script.kill()


def test_the_node_red_flow_is_connected_and_uses_our_topic_and_fields(make):
    nodes = {node["id"]: node for node in FLOW}
    assert len(nodes) == len(FLOW)
    for node in FLOW:
        assert all(target in nodes for wire in node.get("wires", []) for target in wire), node
        assert node.get("broker", "labanmesh-broker") in nodes or node["type"] == "mqtt-broker"
    (source,) = [node for node in FLOW if node["type"] == "mqtt in"]
    assert source["topic"] == Topics("+", "").of("verdict") and source["datatype"] == "json"
    used = {node["property"].partition(".")[2] for node in FLOW if node["type"] == "switch"}
    assert used <= set(verdict_event(make.verdict(1), "decided"))


def test_the_document_names_every_topic_and_every_field_of_an_event(make):
    text = (ROOT / "docs" / "guide" / "home.md").read_text("utf-8")
    topics = Topics("SCENE", "labanmesh/SCENE/bridge")
    own = [topics.bridge, topics.movement("LABEL"), topics.observer("ID", "health"), topics.observer("ID", "state")]
    of_scene = (topics.of(name, "PERSON" if name == "person" else "") for name in get_args(SceneTopic))
    for topic in (*of_scene, *own):
        assert f"`{topic}`" in text, topic
    word = EarlyWord("early", "v1", "ok", "ok", 0.9, make.NOON, make.NOON)
    early = json.loads(early_event(topics, word).payload)
    for name, event in (("verdict", verdict_event(make.verdict(1), "decided")), ("early", early)):
        (row,) = re.findall(rf"^\| `{topics.of(name)}` .*$", text, re.MULTILINE)
        assert set(re.findall(r"`(\w+)`", row)) == set(event)
