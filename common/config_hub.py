"""The sections [hub], [history] and [notify.NAME] of a scene file: where verdicts go, and what is kept
and told. Pure.
"""

import re
from string import Formatter
from typing import Annotated, Literal

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


TEMPLATE_FIELDS = ("what", "when", "sure", "scene", "label", "link")
URL = re.compile(r"https?://[^\s/?#]+(/\S*)?\Z")


def _url(value: str) -> str:
    if value and not URL.match(value):
        raise ValueError("must be http://HOST/PATH or https://HOST/PATH")
    return value


def _template(value: str) -> str:
    try:
        fields = {name for _, name, form, conversion in Formatter().parse(value) if name is not None}
        value.format_map(dict.fromkeys(TEMPLATE_FIELDS, ""))
    except (ValueError, KeyError, IndexError, AttributeError):
        fields = {""}
    if not fields <= set(TEMPLATE_FIELDS):
        raise ValueError(f"may hold {', '.join(f'{{{name}}}' for name in TEMPLATE_FIELDS)} and no other braces")
    return value


Url = Annotated[str, AfterValidator(_url)]
Preset = Literal["json", "ntfy", "gotify", "slack", "discord"]


class HistoryConfig(Section):
    """[history]: file: the SQLite file in which the hub's machine keeps verdicts and falls; "": none is kept.

    keep_days, keep_mb: what is older is deleted, and the oldest of more than this.
    """

    file: Annotated[str, Field(examples=["history.db"])] = ""
    keep_days: Annotated[float, Field(ge=1e-3, le=36_500)] = 365.0
    keep_mb: Annotated[float, Field(ge=1, le=1e6)] = 200.0


class NotifyConfig(Section):
    """[notify.NAME]: a webhook that is told of movements and falls (docs/guide/notify.md).

    url, or url_file for a secret one: where to. preset: what the receiver understands. labels: the movements, "*" for
    all. falls: whether falls are told. template: the text. page: the address of the dashboard, for the link.
    token_file: a file with the receiver's token. secret_file: with the key of the signature. cooldown_s: so long after
    a notification the same label is not told again. timeout_s: for the whole request. keep: how many wait at most.
    keep_hours: for how long.
    """

    url: Url = ""
    url_file: str = ""
    preset: Preset = "json"
    labels: Annotated[tuple[str, ...], Field(strict=False, examples=[["wave"]])] = ()
    falls: bool = True
    template: Annotated[str, AfterValidator(_template)] = "{what} at {when}, {sure}"
    page: Url = ""
    token_file: str = ""
    secret_file: str = ""
    cooldown_s: Annotated[float, Field(ge=0, le=86_400)] = 60.0
    timeout_s: Annotated[float, Field(ge=0.1, le=300)] = 10.0
    keep: Annotated[int, Field(ge=1, le=100_000)] = 1000
    keep_hours: Annotated[float, Field(ge=0.01, le=8760)] = 24.0
