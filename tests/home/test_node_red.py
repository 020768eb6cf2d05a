"""The flow for Node-RED, in a real Node-RED (LABANMESH_NODE_RED names the program): one movement switches a lamp."""

import json
import os
import subprocess

import pytest
from mqtt_stage import Broker, Listener, mosquitto
from played_scene import ROOT

from benchmarks.timing import free_port

SECONDS = 60.0


@pytest.fixture
def flow(tmp_path):
    """Node-RED runs the example with a broker of the test; yields a listener at that broker."""
    program = os.environ.get("LABANMESH_NODE_RED")
    if not program or not mosquitto():
        pytest.skip("LABANMESH_NODE_RED is not set, or there is no mosquitto: make test-home")
    nodes = json.loads((ROOT / "examples" / "node-red-flow.json").read_text("utf-8"))
    with Broker(tmp_path / "broker") as broker, Listener(broker.port) as listener:
        for node in nodes:
            if node["type"] == "mqtt-broker":
                node["port"] = str(broker.port)
        (tmp_path / "flow.json").write_text(json.dumps(nodes))
        command = [program, "--userDir", tmp_path, "--port", str(free_port()), tmp_path / "flow.json"]
        with (tmp_path / "log").open("wb") as log, subprocess.Popen(command, stdout=log, stderr=log) as process:
            try:
                broker.wait_for_subscriber("labanmesh/+/verdict", SECONDS)
                yield listener
            finally:
                process.terminate()


def test_movements_switch_the_lamp_and_doubts_do_not(flow):
    for movement, confidence, expected in (
        ("maestro", 79, ""),
        ("ok", 99, ""),
        ("maestro", 80, "ON"),
        ("byebye", 99, "OFF"),
    ):
        flow.publish("labanmesh/dojo/verdict", json.dumps({"event_type": movement, "confidence": confidence}))
        if expected:
            flow.wait_for_state("lamps/hall/set", expected)
    assert [payload for _, topic, payload, _ in flow.messages if topic == "lamps/hall/set"] == ["ON", "OFF"]
