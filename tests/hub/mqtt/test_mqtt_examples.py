"""The examples for MQTT do what they say, and the document names the topics that there are."""

import json
import re
import shutil
import subprocess

import pytest
from mqtt_stage import ROOT, SOON_S, Listener

from hub.anticipation import EarlyWord
from hub.mqtt.entities import Topics
from hub.mqtt.events import early_event, verdict_event

SCRIPT = ROOT / "examples" / "mqtt.sh"
FLOW = json.loads((ROOT / "examples" / "node-red-flow.json").read_text("utf-8"))


def test_the_shell_example_says_each_verdict(broker, make):
    if not (shutil.which("mosquitto_sub") and shutil.which("jq")):
        pytest.skip("mosquitto_sub or jq is not installed: tests/hub/mqtt/install_mosquitto.sh")
    verdicts = [
        verdict_event(make.verdict(1), "decided"),
        verdict_event(make.verdict(1, label="ok"), "revised"),
        verdict_event(make.verdict(2, label="abstain"), "decided"),
    ]
    command = [SCRIPT, "127.0.0.1", str(broker.port)]
    # Its own group, for mosquitto_sub would outlive the shell.
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True, process_group=0) as script,
        Listener(broker.port, "$SYS/broker/log/#") as listener,
    ):
        try:
            heard = (line.rstrip("\n") for line in script.stdout)
            broker.wait_for_subscriber("labanmesh/+/verdict")
            for verdict in verdicts:
                listener.say("labanmesh/room/verdict", json.dumps(verdict))
            assert next(heard) == "nthrow, 60 % sure, 1 of 2 observers"
            assert next(heard) == "there was a movement, and the observers did not agree which"
        finally:
            subprocess.run(["kill", "--", f"-{script.pid}"], check=True, timeout=SOON_S)


def test_the_node_red_flow_hangs_together_and_listens_to_our_topic():
    nodes = {node["id"]: node for node in FLOW}
    assert len(nodes) == len(FLOW)
    for node in FLOW:
        assert all(target in nodes for wire in node.get("wires", []) for target in wire), node
        assert node.get("broker", "labanmesh-broker") in nodes or node["type"] == "mqtt-broker"
    (source,) = [node for node in FLOW if node["type"] == "mqtt in"]
    assert source["topic"] == Topics("+", "").of("verdict") and source["datatype"] == "json"


def test_the_node_red_flow_asks_for_fields_that_events_have(make):
    event = verdict_event(make.verdict(1), "decided")
    asked = {node["property"].partition(".")[2] for node in FLOW if node["type"] == "switch"}
    assert asked <= set(event)


def test_the_document_tells_every_topic_and_every_field_of_an_event(make):
    text = (ROOT / "docs" / "guide" / "home.md").read_text("utf-8")
    names = Topics("SCENE", "labanmesh/SCENE/bridge")
    topics = [
        names.of("verdict"),
        names.of("ended"),
        names.of("early"),
        names.of("facets"),
        names.of("last_verdict"),
        names.of("state"),
        names.of("votes"),
        names.of("availability"),
        names.bridge,
    ]
    for topic in (*topics, names.movement("LABEL"), *(names.observer("ID", what) for what in ("health", "state"))):
        assert f"`{topic}`" in text, topic
    word = EarlyWord("early", "v1", "ok", "ok", 0.9, make.NOON, make.NOON)
    early = early_event(names, word).payload
    for topic, event in (
        (names.of("verdict"), verdict_event(make.verdict(1), "decided")),
        (names.of("early"), json.loads(early)),
    ):
        (row,) = re.findall(rf"^\| `{topic}` .*$", text, re.MULTILINE)
        assert set(re.findall(r"`(\w+)`", row)) == set(event)
