"""The section [hub] of a scene file with [hub.mqtt] and [hub.dashboard]. Pure."""

import re
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from common.config_sections import Listen, Section, Share

MQTT_PORT, MQTT_TLS_PORT = 1883, 8883
"""The usual ones, as IANA has registered them."""
EVERY_MOVEMENT = "*"
"""In `hub.mqtt.movements`: every movement has a binary sensor, also one that is taught later."""
TOPIC = re.compile(r"[a-zA-Z0-9_-]+(/[a-zA-Z0-9_-]+)*\Z")


def _topic(value: str) -> str:
    if not TOPIC.match(value):
        raise ValueError("must be parts of a-z, A-Z, 0-9, _ and -, with / between them; leave it out for the usual one")
    return value


def _host(value: str) -> str:
    try:
        is_name = bool(value.encode("idna")) and not any(c.isspace() or c == "/" for c in value)
    except UnicodeError:
        is_name = False
    if not is_name:
        raise ValueError('not a host name; e.g. "127.0.0.1" or "homeassistant.local"')
    return value


class MqttConfig(Section):
    """[hub.mqtt]: the broker through which Home Assistant and others receive the scene.

    password_file: a file that holds only the password. tls: encrypt; the broker's certificate is checked against the
    system's authorities or those in ca_file. discovery: Home Assistant's discovery prefix. topics: prefix of the state
    topics. movements: those with a binary sensor of their own. area: the suggested area of the devices.
    """

    host: Annotated[str, AfterValidator(_host)] = "127.0.0.1"
    port: Annotated[int, Field(ge=1, le=65535, examples=[1883])] | None = None
    username: str = ""
    password_file: str = ""
    tls: bool = False
    ca_file: str = ""
    discovery: Annotated[str, AfterValidator(_topic)] = "homeassistant"
    topics: Annotated[str, AfterValidator(_topic)] = "labanmesh"
    movements: Annotated[tuple[str, ...], Field(strict=False, examples=[["wave", "clap"]])] = ()
    area: str = ""

    @model_validator(mode="after")
    def _is_complete(self) -> "MqttConfig":
        if self.password_file and not self.username:
            rule = "a password needs a user; set hub.mqtt.username too"
            raise ValueError(f"password_file = {self.password_file!r}: {rule}")
        if self.ca_file and not self.tls:
            rule = "applies to an encrypted connection; set hub.mqtt.tls = true, or remove it"
            raise ValueError(f"ca_file = {self.ca_file!r}: {rule}")
        return self

    @property
    def own_port(self) -> int:
        """`port`, or the usual one."""
        return self.port or (MQTT_TLS_PORT if self.tls else MQTT_PORT)


class DashboardConfig(Section):
    """[hub.dashboard]: the web page. listen: HOST:PORT. token_file: a file with the token that a browser must send.

    teach: whoever has the token may also teach the observers on the page.
    """

    listen: Listen = "127.0.0.1:8420"
    token_file: str = ""
    teach: bool = False


class HubConfig(Section):
    """[hub]: listeners. start: those that `labanmesh up` starts: "mqtt", "dashboard", and verbs of installed
    packages; with [history] or [notify.NAME] it also starts `hub events`.

    certainty: the probability from which a movement is announced before it is decided; 1: never.
    """

    start: Annotated[tuple[str, ...], Field(strict=False, examples=[["dashboard"]])] = ()
    certainty: Share = 1.0
    mqtt: MqttConfig = MqttConfig()
    dashboard: DashboardConfig = DashboardConfig()
