"""The sections of a scene file: an immutable model each; every key but an observer's source has a default. Pure."""

import re
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    field_validator,
    model_validator,
)

from common.address import ADDRESS_RULE, Address
from common.fusion_rules import DEFAULT_RULE

MOST_SPEED = 1000.0
MOST_DIGITS = 9
MOST_PORT = 65_535
ENDPOINT = re.compile(r"(tcp|tls|quic|udp|ws)/[^\s/#?]+:(?P<port>\d{1,5})([#?]\S*)?\Z|unixsock-stream/\S+\Z")


def _endpoint(value: str) -> str:
    match = ENDPOINT.match(value)
    if not match:
        raise ValueError("must be PROTOCOL/HOST:PORT, e.g. tcp/127.0.0.1:7447 (protocols: tcp, tls, quic, udp, ws)")
    if int(match["port"] or 0) > MOST_PORT:
        raise ValueError(f"the port must be 1 to {MOST_PORT}, e.g. tcp/127.0.0.1:7447")
    return value


def _speed(value: float) -> float:
    if value != 0 and not MOST_SPEED >= value >= 1 / MOST_SPEED:
        raise ValueError(f"must be 0 (as fast as possible), or {1 / MOST_SPEED:g} to {MOST_SPEED:g}")
    return value


def _recording(value: object) -> int | Literal["all"]:
    if value == "all":
        return "all"
    if isinstance(value, str) and value.isdecimal() and len(value) < MOST_DIGITS:
        return int(value)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 10**MOST_DIGITS:
        raise ValueError('must be the index of a recording, from 0, or "all"')
    return value


def _listen(value: str) -> str:
    if value and Address.parsed(value) is None:
        raise ValueError(ADDRESS_RULE)
    return value


Listen = Annotated[str, AfterValidator(_listen)]
"""HOST:PORT, or "" for nowhere."""
Share = Annotated[float, Field(ge=0, le=1)]
Seconds = Annotated[float, Field(ge=0, le=86_400)]
Duration = Annotated[float, Field(ge=1e-3, le=86_400)]
"""Seconds that something is divided by."""
Hertz = Annotated[float, Field(ge=0.01, le=10_000, examples=[15.0])]
Pixels = Annotated[int, Field(ge=1, le=16_384)]
Position = Annotated[int, Field(ge=-16_384, le=16_384)]
"""In a picture; px."""
Metres = Annotated[float, Field(ge=-10_000, le=10_000)]
Degrees = Annotated[float, Field(ge=-36_000, le=36_000, examples=[90.0])]
ClipSeconds = Annotated[float, Field(ge=0, le=30)]


Place = Annotated[tuple[Metres, ...], Field(strict=False, min_length=2, max_length=3, examples=[[0.5, 2.0]])]
"""[x, z] on the floor, or [x, y, z] with the height y of the head; metres, in the axes of the camera files."""


class Section(BaseModel):
    """The base of all sections: immutable, without unknown keys, and without conversion of types."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _is_text(cls, value: object) -> object:
        if isinstance(value, str) and "\0" in value:
            raise ValueError("must not contain the character NUL")
        return value


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
    def _is_secured(self) -> "MeshConfig":
        setting = f"credentials = {self.credentials!r}"
        if self.credentials and self.mode != "router":
            rule = 'only a router checks certificates; set mesh.mode = "router" or remove this key'
            raise ValueError(f"{setting}: {rule}")
        if self.credentials and not self.endpoint.startswith(("tls/", "quic/")):
            raise ValueError(f"{setting}: mesh.endpoint = {self.endpoint!r} is not encrypted; write tls/HOST:PORT")
        return self

    def at(self, endpoint: str) -> "MeshConfig":
        """The same mesh at another endpoint, e.g. the one that a link really listens on."""
        return self.model_copy(update={"endpoint": endpoint})


class PersonConfig(Section):
    """[person]: where the person stands in the room of the camera files, and the degrees that they face.

    None: not known. facing: 0 faces along -z, where the view yaw:0 looks from, and grows to the person's left.
    """

    place: Place | None = None
    facing: Degrees | None = None


class ClipsConfig(Section):
    """[observers.ID.clips]: a short film of each verdict, kept on the observer's own machine.

    folder: where; "": no clips. seconds: before and after the decision. keep_days, keep_mb: older clips, and the oldest
    of more than this, are deleted.
    """

    folder: str = ""
    seconds: Annotated[tuple[ClipSeconds, ClipSeconds], Field(strict=False)] = (4.0, 2.0)
    keep_days: Annotated[float, Field(ge=1e-3, le=36_500)] = 7.0
    keep_mb: Annotated[float, Field(ge=1, le=1e9)] = 500.0


class ObserverConfig(Section):
    """[observers.ID]: the source of one observer, its tracker and its model.

    direction: whether the camera's direction in the room is known to be `view`; an observer with "unknown" publishes no
    facings. speed: factor on the speed of a recording; 0 is as fast as possible. model: a file name, by default
    ID.model once the scene is read. tracker: "auto" selects one for the source. rate_hz, size_px: requested of a
    camera. mirrored: the pictures are mirrored, as selfies are. show_path: the camera's address is printed with its
    path, which may hold a secret. skin, face: settings of `camshift` for the person (a file;
    x, y, width, height in px). pose_model, hand: the model file of a pose model, and which place is the hand. follow:
    which of several people a pose model follows; follow_near: the marked place for "nearest", shares of the picture.
    picture_hz: live pictures a second for the dashboard; 0: none ever. effort: the file of the Effort model; "": no
    Effort. say: when posteriors are published. place, facing: of the person, as in [person], if this camera's room has
    axes of its own. max_hz, idle_hz: runs of the tracker of pictures per second, while the person moves and while
    nothing does; None: by their cost.
    """

    source: Annotated[str, Field(min_length=1, examples=["0"])]
    view: Annotated[str, Field(min_length=1, examples=["yaw:30"])] = "door"
    direction: Literal["known", "unknown"] = "known"
    model: str = ""
    speed: Annotated[float, AfterValidator(_speed)] = 1.0
    recording: Annotated[int | Literal["all"], PlainValidator(_recording)] = 0
    loop: bool = False
    onset: Literal["unknown", "known"] = "unknown"
    tracker: str = "auto"
    rate_hz: Hertz | None = None
    max_hz: Hertz | None = None
    idle_hz: Hertz | None = None
    size_px: Annotated[tuple[Pixels, Pixels] | None, Field(strict=False, examples=[[640, 480]])] = None
    mirrored: bool = False
    show_path: bool = False
    skin: str = ""
    face: Annotated[
        tuple[Position, Position, Pixels, Pixels] | None, Field(strict=False, examples=[[300, 120, 80, 80]])
    ] = None
    pose_model: str = ""
    hand: Literal["palm", "wrist"] = "palm"
    follow: Literal["largest", "nearest", "raised_hand"] = "largest"
    follow_near: Annotated[tuple[Share, Share] | None, Field(strict=False, examples=[[0.5, 0.5]])] = None
    picture_hz: Annotated[float, Field(ge=0, le=5)] = 0.0
    effort: str = ""
    say: Literal["each frame", "on change"] = "each frame"
    place: Place | None = None
    facing: Degrees | None = None
    clips: ClipsConfig = ClipsConfig()

    @model_validator(mode="after")
    def _has_a_mark_to_be_near(self) -> "ObserverConfig":
        if (self.follow == "nearest") != (self.follow_near is not None):
            raise ValueError(
                f'follow = "{self.follow}", follow_near = {self.follow_near}: follow = "nearest" needs a marked place,'
                " follow_near = [u, v], and no other rule has one"
            )
        return self


class FusionConfig(Section):
    """[fusion]: how posteriors are pooled and verdicts decided; seconds and probabilities.

    quorum: least number of observers that must agree; by default half of the scene's observers. fresh_s, fade_s,
    drop_s: how a posterior ages; blind_s: how one fades whose observer sees no body part. step_hz: least rate of
    judgements. standby: ids of further fusion services; one of them takes over if the active one is gone, or silent for
    takeover_s. start_s: how long verdicts wait, after the first posterior, for observers that have not begun; 0: not.
    memory: a file or folder for checkpoints of the movement in progress and the learned reliability; None: a file in
    $STATE_DIRECTORY or beside the scene file; "": none.
    temperature: of the pooled posterior; above 1 makes it less certain. votes: those in judgements. periodic: the
    labels that are one movement for as long as they are repeated; None: those whose takes are periodic.
    """

    id: str = "fusion"
    rule: str = DEFAULT_RULE
    quorum: Annotated[int, Field(ge=1, le=1000)] = 1
    temperature: Annotated[float, Field(ge=1e-3, le=1e3)] = 1.0
    threshold: Annotated[float, Field(ge=1e-3, le=1)] = 0.6
    hold_s: Seconds = 0.1
    fresh_s: Seconds = 0.2
    fade_s: Duration = 0.5
    blind_s: Duration = 0.15
    drop_s: Duration = 2.0
    step_hz: Annotated[float, Field(ge=0.1, le=1000)] = 10.0
    standby: Annotated[tuple[str, ...], Field(strict=False, examples=[["fusion2"]])] = ()
    takeover_s: Duration = 0.5
    start_s: Annotated[float, Field(ge=0, le=60)] = 3.0
    memory: Annotated[str, Field(examples=["fusion.memory"])] | None = None
    votes: Literal["short", "full"] = "short"
    periodic: Annotated[tuple[str, ...], Field(strict=False, examples=[["wave"]])] | None = None


def default_quorum(observers: int) -> int:
    """Half of the observers, rounded up: pooling weighs them already, and a majority of two would need both."""
    return max((observers + 1) // 2, 1)


class TeachingConfig(Section):
    """[teaching]: remember_minutes: how long each observer remembers its own tracks, in memory only, so that a wrong or
    missed verdict can become an example; 0: not at all outside a lesson.
    """

    remember_minutes: Annotated[float, Field(ge=0, le=60)] = 10.0


class MetricsConfig(Section):
    """[metrics]: listen: HOST:PORT where each process answers /metrics, /healthz and /readyz; "": nowhere.

    With `labanmesh up` the first process has this port, and each further one the next port.
    """

    listen: Listen = ""
