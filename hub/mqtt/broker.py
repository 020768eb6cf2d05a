"""The MQTT broker of the scene files: address, identity, password and certificate, its faults, and removing a scene."""

import asyncio
import json
import ssl
from collections.abc import Iterable
from dataclasses import dataclass

from aiomqtt import Client, MqttCodeError, MqttError, Will

from common.config import MqttConfig, Scene
from common.config_hub import MQTT_PORT, MQTT_TLS_PORT
from common.errors import BadInput, LabanmeshError, reason_of
from hub.mqtt.bridge import topics_of
from hub.mqtt.entities import ORIGIN, Topics, bridge_topic
from hub.mqtt.states import OFFLINE, ONLINE

KEEPALIVE_S = 10
"""A broker publishes our last will after one and a half of these without a sign of life."""
CONNECTION_TIMEOUT_S = 5.0
"""For connecting and subscribing, and for what is still to be sent when the hub ends."""
COLLECT_S = 10.0
PENDING_LIMIT = 1000
"""How many unconfirmed events are allowed before the library warns."""
IDENTITY_FAULTS = (
    "not authorized",
    "bad user name or password",
    "banned",
    "client identifier not valid",
    "unsupported protocol",
)
"""Faults that trying again does not cure."""


@dataclass(frozen=True, slots=True)
class MqttBroker:
    """Address of the broker and our identity there; the last will is published under `bridge`."""

    host: str
    port: int
    username: str
    password: str | None
    tls: ssl.SSLContext | None
    identifier: str
    bridge: str

    @property
    def address(self) -> str:
        """HOST:PORT."""
        return f"{self.host}:{self.port}"

    def client(self) -> Client:
        """A connection, used once as a context manager."""
        client = Client(
            self.host, self.port, username=self.username or None, password=self.password, identifier=self.identifier,
            tls_context=self.tls, will=Will(self.bridge, OFFLINE, qos=1, retain=True), timeout=CONNECTION_TIMEOUT_S,
            keepalive=KEEPALIVE_S, max_queued_outgoing_messages=0,
        )  # fmt: skip
        client.pending_calls_threshold = PENDING_LIMIT
        return client


def broker_of(scene: Scene, purpose: str = "") -> MqttBroker:
    """The broker of `scene`; raises BadInput that names the faulty key. purpose: set for a second connection."""
    config = scene.hub.mqtt
    identifier = f"labanmesh-hub-{scene.scene}" + (f"-{purpose}" if purpose else "")
    return MqttBroker(
        config.host, config.own_port, config.username, _password(scene),
        _tls(scene), identifier, bridge_topic(config.topics, scene.scene),
    )  # fmt: skip


def _password(scene: Scene) -> str | None:
    config = scene.hub.mqtt
    if not config.password_file:
        return None
    key = f"hub.mqtt.password_file = {config.password_file!r}"
    try:
        password = scene.place(config.password_file).read_text(encoding="utf-8").rstrip("\r\n")
    except (OSError, UnicodeDecodeError) as error:
        reason = reason_of(error) if isinstance(error, OSError) else "not UTF-8 text"
        raise BadInput(f"{key}: {reason}; it must be a file that holds only the password") from None
    if not password or "\n" in password:
        raise BadInput(f"{key}: must hold one line, the password, and holds {len(password.splitlines())}")
    return password


def _tls(scene: Scene) -> ssl.SSLContext | None:
    config = scene.hub.mqtt
    if not config.tls:
        return None
    try:
        return ssl.create_default_context(cafile=str(scene.place(config.ca_file)) if config.ca_file else None)
    except OSError as error:
        reason = "holds no certificate" if isinstance(error, ssl.SSLError) else reason_of(error)
        fault = f"hub.mqtt.ca_file = {config.ca_file!r}: {reason}"
        raise BadInput(f"{fault}; name the PEM file of the broker's authority") from None


def permanent_fault(error: MqttError, broker: MqttBroker, config: MqttConfig) -> str | None:
    """One line for a fault at the first connection that trying again does not cure; None: it may pass."""
    text = str(error)
    if isinstance(error, MqttCodeError) and any(fault in text.lower() for fault in IDENTITY_FAULTS):
        user = f"user {broker.username!r}" if broker.username else "a client without a user name"
        keys = "hub.mqtt.username and hub.mqtt.password_file"
        return f"hub.mqtt: the broker at {broker.address} refuses {user}: {_plain(text)}; see {keys}"
    if "certificate verify failed" in text.lower():
        reason = text.partition("certificate verify failed:")[2].partition("(_ssl")[0].strip()
        way_out = "name its authority here, or set hub.mqtt.host to the name in the certificate"
        key = f"hub.mqtt.ca_file = {config.ca_file!r}"
        return f"{key}: the certificate of {broker.address} is not valid: {reason}; {way_out}"
    return None


def fault_text(error: MqttError, broker: MqttBroker) -> str:
    """Why there is no connection now, in a few words."""
    text = _plain(str(error.__cause__ or error))
    if "wrong_version_number" in text or "record_layer_failure" in text:
        ports = f"the usual ports are {MQTT_TLS_PORT} with TLS and {MQTT_PORT} without"
        return f"{broker.address} does not speak TLS; look at hub.mqtt.port: {ports}"
    return text


def _plain(text: str) -> str:
    """Lower case, without the error numbers that libraries put first."""
    for opening in ("[code:", "[Errno "):
        if text.startswith(opening):
            text = text.partition("] ")[2]
    return " ".join(text.split()).lower() or "no answer"


def remove(scene: Scene) -> int:
    """Delete everything that hubs have retained for `scene` at its broker; returns how many messages.

    Home Assistant then drops its entities. Raises BadInput while a hub still serves the scene, LabanmeshError when
    there is no broker.
    """
    broker = broker_of(scene, "remove")
    try:
        return asyncio.run(_remove(scene, broker))
    except MqttError as error:
        fault = permanent_fault(error, broker, scene.hub.mqtt)
        if fault is not None:
            raise BadInput(fault) from None
        reason = fault_text(error, broker)
        raise LabanmeshError(f"no MQTT broker at {broker.address}: {reason}; is it running?") from None


async def _remove(scene: Scene, broker: MqttBroker) -> int:
    topics = topics_of(scene, broker.bridge)
    async with broker.client() as client:
        retained = await _collect(client, topics)
        ours = {topic for topic, payload in retained.items() if _is_ours(topic, payload, topics)}
        for bridge in _bridges(retained[topic] for topic in ours):
            if retained.get(bridge) == ONLINE.encode():
                raise BadInput(f"{scene.scene}: a hub still serves it ({bridge}); stop that hub first")
        for topic in sorted(ours):
            await client.publish(topic, b"", qos=1, retain=True)
    return len(ours)


async def _collect(client: Client, topics: Topics) -> dict[str, bytes]:
    """All retained messages below the prefixes; raises LabanmeshError when the broker does not let us read them."""
    end_mark = f"{topics.root}/removing"
    for topic in (f"{topics.discovery}/+/+/config", f"{topics.root}/#", f"{topics.topics}/+/bridge"):
        await client.subscribe(topic)
    # The broker sends it back after all retained messages.
    await client.publish(end_mark, b"", qos=1)
    retained: dict[str, bytes] = {}
    try:
        async with asyncio.timeout(COLLECT_S):
            async for message in client.messages:
                if str(message.topic) == end_mark:
                    return retained
                if isinstance(message.payload, bytes):
                    retained[str(message.topic)] = message.payload
    except TimeoutError:
        pass
    raise LabanmeshError(f"hub.mqtt: the broker does not let us read below {topics.root}; check its access rules")


def _is_ours(topic: str, payload: bytes, topics: Topics) -> bool:
    if topic.startswith(f"{topics.root}/"):
        return True
    fields = _json_object(payload)
    # A device trigger has a topic and no state.
    source = str(fields.get("state_topic") or fields.get("topic"))
    return fields.get("origin") == {"name": ORIGIN} and source.startswith(f"{topics.root}/")


def _bridges(payloads: Iterable[bytes]) -> set[str]:
    """The topics under which the hubs of these entities show whether they are connected."""
    lists = [_json_object(payload).get("availability") for payload in payloads]
    entries = [entry for entries in lists if isinstance(entries, list) for entry in entries if isinstance(entry, dict)]
    return {str(entry["topic"]) for entry in entries if str(entry.get("topic")).endswith("/bridge")}


def _json_object(payload: bytes) -> dict[str, object]:
    try:
        value = json.loads(payload)
    except (ValueError, RecursionError):
        return {}
    return value if isinstance(value, dict) else {}
