"""The broker as the scene files name it: who we are there, with which password and certificate, and its faults."""

import ssl
from dataclasses import dataclass

from aiomqtt import Client, MqttCodeError, MqttError, Will

from common.config import MqttConfig, Scene
from common.errors import BadInput
from hub.mqtt.names import bridge_topic, client_id, prefix
from hub.mqtt.picture import OFFLINE

PORT, TLS_PORT = 1883, 8883
KEEPALIVE_S = 10
"""A broker whose line is cut takes us for gone after one and a half of these, and says our last will."""
PATIENCE_S = 5.0
PENDING = 1000
"""So many events may wait for the broker's word at once before its library complains."""
IDENTITY = (
    "not authorized",
    "bad user name or password",
    "banned",
    "client identifier not valid",
    "unsupported protocol",
)
"""Refusals that trying again does not cure."""


@dataclass(frozen=True, slots=True)
class Broker:
    """Where the broker is and who we are there; the last will is said under `bridge`."""

    host: str
    port: int
    username: str
    password: str | None
    tls: ssl.SSLContext | None
    identifier: str
    bridge: str

    @property
    def address(self) -> str:
        """For people."""
        return f"{self.host}:{self.port}"

    def client(self) -> Client:
        """A connection to be entered; each is used once."""
        client = Client(
            self.host, self.port, username=self.username or None, password=self.password, identifier=self.identifier,
            tls_context=self.tls, will=Will(self.bridge, OFFLINE, qos=1, retain=True), timeout=PATIENCE_S,
            keepalive=KEEPALIVE_S, max_queued_outgoing_messages=0,
        )  # fmt: skip
        client.pending_calls_threshold = PENDING
        return client


def broker_of(scene: Scene, purpose: str = "") -> Broker:
    """The broker of `scene`, in whose name we are there; raises BadInput that names the key and the way out.

    purpose: for another connection than the hub's own.
    """
    asked = scene.hub.mqtt
    for key in ("discovery", "topics"):
        prefix(getattr(asked, key), f"hub.mqtt.{key}")
    _require_host(asked.host)
    identifier = client_id(scene.scene) + (f"-{purpose}" if purpose else "")
    return Broker(
        asked.host, asked.port or (TLS_PORT if asked.tls else PORT), asked.username, _password(scene),
        _tls(scene), identifier, bridge_topic(asked.topics, scene.scene),
    )  # fmt: skip


def _require_host(host: str) -> None:
    named = f"hub.mqtt.host = {host!r}"
    try:
        legal = bool(host.encode("idna")) and not any(c.isspace() or c == "/" for c in host)
    except UnicodeError:
        legal = False
    if not legal:
        raise BadInput(f'{named}: no name of a machine; e.g. "127.0.0.1" or "homeassistant.local"')


def _password(scene: Scene) -> str | None:
    asked = scene.hub.mqtt
    if not asked.password_file:
        return None
    named = f"hub.mqtt.password_file = {asked.password_file!r}"
    if not asked.username:
        raise BadInput(f"{named}: whose password? name hub.mqtt.username too")
    try:
        password = scene.place(asked.password_file).read_text(encoding="utf-8").rstrip("\r\n")
    except OSError as error:
        raise BadInput(f"{named}: {(error.strerror or str(error)).lower()}; a file with the password alone") from None
    except UnicodeDecodeError:
        raise BadInput(f"{named}: not UTF-8 text; a file with the password alone") from None
    if not password or "\n" in password:
        raise BadInput(f"{named}: must hold one line, the password, and holds {len(password.splitlines())}")
    return password


def _tls(scene: Scene) -> ssl.SSLContext | None:
    asked = scene.hub.mqtt
    named = f"hub.mqtt.ca_file = {asked.ca_file!r}"
    if not asked.tls:
        if asked.ca_file:
            raise BadInput(f"{named}: is for an encrypted connection; set hub.mqtt.tls = true, or take it out")
        return None
    try:
        return ssl.create_default_context(cafile=str(scene.place(asked.ca_file)) if asked.ca_file else None)
    except ssl.SSLError:
        raise BadInput(f"{named}: no certificates in it; the authority of the broker's certificate, PEM") from None
    except OSError as error:
        raise BadInput(f"{named}: {(error.strerror or str(error)).lower()}; the broker's authority, PEM") from None


def incurable(error: MqttError, broker: Broker, asked: MqttConfig) -> str | None:
    """A fault at the first connection that trying again does not cure, as one line; None: it may pass."""
    said = str(error)
    if isinstance(error, MqttCodeError) and any(words in said.lower() for words in IDENTITY):
        who = f"user {broker.username!r}" if broker.username else "who has no name"
        way_out = "hub.mqtt.username and hub.mqtt.password_file"
        return f"hub.mqtt: the broker at {broker.address} refuses {who}: {_plain(said)}; see {way_out}"
    if "certificate verify failed" in said.lower():
        reason = said.partition("certificate verify failed:")[2].partition("(_ssl")[0].strip()
        way_out = "name its authority here, or in hub.mqtt.host the name that it is for"
        named = f"hub.mqtt.ca_file = {asked.ca_file!r}"
        return f"{named}: the certificate of {broker.address} is not valid: {reason}; {way_out}"
    return None


def in_words(error: MqttError, broker: Broker) -> str:
    """Why there is no connection now, in a few words."""
    said = _plain(str(error.__cause__ or error))
    if "WRONG_VERSION_NUMBER" in said or "RECORD_LAYER_FAILURE" in said:
        return f"{broker.address} does not speak TLS; hub.mqtt.port is for TLS {TLS_PORT} by custom, else {PORT}"
    return said


def _plain(said: str) -> str:
    """Without the numbers of errors that the libraries put before their words."""
    for opening, closing in (("[code:", "] "), ("[Errno ", "] ")):
        if said.startswith(opening):
            said = said.partition(closing)[2]
    return " ".join(said.split()).lower() or "no answer"
