"""The MQTT broker of the scene file, `[hub.mqtt]`, through which Home Assistant receives the scene.

A scene file that neither starts the hub nor names a broker has no findings here. `check_broker` is pure.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from common.config import Scene
from common.config_hub import MqttConfig
from common.errors import reason_of
from deploy.doctor.findings import Finding, Mark, ok
from deploy.doctor.network import Connection, connect_to


@dataclass(frozen=True, slots=True)
class BrokerFacts:
    """The broker. starts: whether `labanmesh up` starts the hub. installed: whether it can run here.

    password: why its file cannot be used; "" where it can, or none is named.
    """

    address: str
    connection: Connection
    starts: bool
    installed: bool
    password_file: str = ""
    password: str = ""


def broker_facts(scene: Scene) -> BrokerFacts | None:
    """The facts; None where the scene file wants no broker."""
    mqtt, starts = scene.hub.mqtt, "mqtt" in scene.hub.start
    if not starts and mqtt == MqttConfig():
        return None
    connection, installed = connect_to(mqtt.host, mqtt.own_port), find_spec("aiomqtt") is not None
    address, fault = f"{mqtt.host}:{mqtt.own_port}", _password_fault(scene, mqtt)
    return BrokerFacts(address, connection, starts, installed, mqtt.password_file, fault)


def _password_fault(scene: Scene, mqtt: MqttConfig) -> str:
    if not mqtt.password_file:
        return ""
    try:
        with scene.place(mqtt.password_file).open("rb") as file:
            return "" if file.read(1) else "is empty"
    except OSError as error:
        return reason_of(error)


def check_broker(facts: BrokerFacts | None) -> Iterator[Finding]:
    """The findings; errors only where `labanmesh up` starts the hub here."""
    if facts is None:
        return
    mark: Mark = "error" if facts.starts else "warning"
    if not facts.installed:
        yield Finding(mark, "aiomqtt is not installed: labanmesh hub mqtt needs it", "pip install 'labanmesh[mqtt]'")
    if facts.password:
        write = f"printf '%s' 'the password' > {Path(facts.password_file).name}, beside the scene file"
        yield Finding(mark, f"hub.mqtt.password_file = {facts.password_file!r}: {facts.password}", write)
    if facts.connection.fault:
        what = f"no MQTT broker at {facts.address}: {facts.connection.fault}"
        to_do = "start it (in Home Assistant: the app Mosquitto broker), or correct hub.mqtt.host"
        yield Finding(mark, what, to_do)
    elif facts.connection.took_s is not None:
        yield ok(f"MQTT broker {facts.address}: answers, {1000 * facts.connection.took_s:.1f} ms")
