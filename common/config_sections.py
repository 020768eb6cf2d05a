"""The sections of a scene file: a frozen model each, with a default for every key but the observers' sources. Pure."""

import re
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    PositiveFloat,
    PositiveInt,
    model_validator,
)

from common.errors import BadInput

ENDPOINT = re.compile(r"(tcp|tls|quic|udp|ws)/[^\s/#?]+:\d{1,5}([#?]\S*)?\Z|unixsock-stream/\S+\Z")


def _endpoint(value: str) -> str:
    if not ENDPOINT.match(value):
        raise ValueError("must be PROTOCOL/HOST:PORT, e.g. tcp/127.0.0.1:7447 (protocols: tcp, tls, quic, udp, ws)")
    return value


def _recording(value: object) -> int | Literal["all"]:
    if value == "all":
        return "all"
    if isinstance(value, str) and value.isdecimal():
        return int(value)
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ValueError('must be the index of a recording, from 0, or "all"')
    return value


Share = Annotated[float, Field(ge=0, le=1)]
Seconds = Annotated[float, Field(ge=0)]
Occlusion = Annotated[tuple[Share, Share, Share, Share, Seconds, Seconds], Field(strict=False)]


class Section(BaseModel):
    """What all parts of the file share: never changed after reading, no unknown keys, no guessing of types."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class MeshConfig(Section):
    """[mesh]: how the processes find each other.

    mode: "machine" (peers on one machine; the fusion process listens on `endpoint`), "router" (clients of the router
    that listens on `endpoint`) or "process" (peers inside one process, as in tests and the demo).
    credentials: "", or the folder with this machine's ca.pem, certificate.pem and key.pem (docs/design/security.md).
    """

    mode: Literal["machine", "router", "process"] = "machine"
    endpoint: Annotated[str, AfterValidator(_endpoint)] = "tcp/127.0.0.1:7447"
    prefix: str = "laban"
    credentials: str = ""

    @model_validator(mode="after")
    def _is_secured_whole(self) -> "MeshConfig":
        named = f"mesh.credentials = {self.credentials!r}"
        if self.credentials and self.mode != "router":
            raise BadInput(f'{named}: only a router can refuse anybody; set mesh.mode = "router", or take it out')
        if self.credentials and not self.endpoint.startswith(("tls/", "quic/")):
            raise BadInput(f"{named}: mesh.endpoint = {self.endpoint!r} is not encrypted; write tls/HOST:PORT")
        return self

    def at(self, endpoint: str) -> "MeshConfig":
        """The same mesh, met at another endpoint, e.g. the one that a link really listens on."""
        return self.model_copy(update={"endpoint": endpoint})


class VirtualConfig(Section):
    """[observers.ID.virtual]: room and camera that recorded motion is filmed with for a tracker that wants pictures.

    Shares are 0 to 1. occluders: rows of left, top, width, height (shares of the picture), first and last second of the
    motion. The same seed gives the same pictures.
    """

    background: Literal["plain", "cluttered", "skin_toned"] = "plain"
    noise: Annotated[float, Field(ge=0, le=64)] = 2.0
    slow_light: Annotated[float, Field(ge=0, le=1)] = 0.0
    sudden_light: Annotated[float, Field(ge=0, le=1)] = 0.0
    blur: Annotated[float, Field(ge=0, le=1)] = 0.0
    occluders: Annotated[tuple[Occlusion, ...], Field(strict=False)] = ()
    seed: Annotated[int, Field(ge=0)] = 0


class ObserverConfig(Section):
    """[observers.ID]: what one observer looks at, how it finds the body parts, and with which model.

    direction: whether `view` is where it really looks from in the room; if not, what it says of facing stays with it.
    speed: what was recorded is played this much faster than it was; 0 is as fast as possible. model: "" until the
    scene is read, then a file name (by default ID.model). tracker: "auto" chooses by the source. rate_hz, size_px:
    what a camera is asked for. mirrored: the pictures are, as selfies are. skin, face: what `camshift` may be told of
    the person (a file; x, y, width, height in px). pose_model, hand: the model file of `mediapipe`, and what
    it takes for a hand. preview: a film to write of what it sees. effort: the file of its Effort model; "": Effort is
    not judged. say: when it says what it believes.
    """

    source: Annotated[str, Field(min_length=1)]
    view: Annotated[str, Field(min_length=1)] = "door"
    direction: Literal["known", "unknown"] = "known"
    model: str = ""
    speed: Annotated[float, Field(ge=0)] = 1.0
    recording: Annotated[int | Literal["all"], PlainValidator(_recording)] = 0
    loop: bool = False
    onset: Literal["unknown", "known"] = "unknown"
    tracker: str = "auto"
    rate_hz: PositiveFloat | None = None
    size_px: Annotated[tuple[PositiveInt, PositiveInt] | None, Field(strict=False)] = None
    mirrored: bool = False
    skin: str = ""
    face: Annotated[tuple[int, int, PositiveInt, PositiveInt] | None, Field(strict=False)] = None
    pose_model: str = ""
    hand: Literal["palm", "wrist"] = "palm"
    preview: str = ""
    effort: str = ""
    say: Literal["each frame", "on change"] = "each frame"
    virtual: VirtualConfig = VirtualConfig()


class FusionConfig(Section):
    """[fusion]: how the referee judges; seconds and probabilities.

    quorum: least number of agreeing judges; in a scene that does not say, half of its observers.
    fresh_s, fade_s, drop_s: how an opinion ages; blind_s: how that of who sees nothing fades. step_hz: judgements per
    second at least. standby: ids of further fusion services, of which one takes over when the leading one is gone or
    silent for takeover_s. memory: a file in which the movement that goes on, and what was learned of the observers, is
    kept over a restart; "": none. temperature: of the pooled belief; above 1 it is less sure.
    """

    id: str = "fusion"
    rule: str = "robust_inverse_entropy"
    quorum: Annotated[int, Field(ge=1)] = 1
    temperature: PositiveFloat = 1.0
    threshold: Annotated[float, Field(gt=0, le=1)] = 0.8
    hold_s: Annotated[float, Field(ge=0)] = 0.2
    fresh_s: Annotated[float, Field(ge=0)] = 0.2
    fade_s: PositiveFloat = 0.5
    blind_s: PositiveFloat = 0.15
    drop_s: PositiveFloat = 2.0
    step_hz: Annotated[float, Field(ge=0.1, le=1000)] = 10.0
    standby: Annotated[tuple[str, ...], Field(strict=False)] = ()
    takeover_s: PositiveFloat = 0.5
    memory: str = ""


def default_quorum(observers: int) -> int:
    """Half of them: they are weighed before they are counted, and a majority of two would be both."""
    return max((observers + 1) // 2, 1)


class MqttConfig(Section):
    """[hub.mqtt]: the broker through which Home Assistant and others hear of the scene.

    password_file: a file with the password alone. tls: encrypted, by the system's authorities or those in ca_file.
    discovery: the prefix under which Home Assistant looks for entities. topics: under which states are said.
    movements: those that get a binary sensor of their own. area: where Home Assistant shall put the devices.
    """

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=1, le=65535)] | None = None
    username: str = ""
    password_file: str = ""
    tls: bool = False
    ca_file: str = ""
    discovery: str = "homeassistant"
    topics: str = "labanmesh"
    movements: Annotated[tuple[str, ...], Field(strict=False)] = ()
    area: str = ""


class DashboardConfig(Section):
    """[hub.dashboard]: the page. listen: HOST:PORT. token_file: a file with the word that a browser must know."""

    listen: str = "127.0.0.1:8420"
    token_file: str = ""


class HubConfig(Section):
    """[hub]: who listens. start: which of them `labanmesh up` starts, of "mqtt" and "dashboard".

    certainty: how likely a movement must be to be named before it is decided; 1: none is.
    """

    start: Annotated[tuple[Literal["mqtt", "dashboard"], ...], Field(strict=False)] = ()
    certainty: Share = 1.0
    mqtt: MqttConfig = MqttConfig()
    dashboard: DashboardConfig = DashboardConfig()


class MetricsConfig(Section):
    """[metrics]: listen: HOST:PORT where each process answers /metrics, /healthz and /readyz; "": nowhere.

    With `labanmesh up` the first process has that port, and each further one the next.
    """

    listen: str = ""
