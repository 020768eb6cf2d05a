"""The scene file: one TOML file that describes a scene and that every process of it reads (docs/scene.md).

Each section is a frozen model with a default for every key but the scene's name and the observers' sources; which
environment variables override it is in config_environment.py, how faults are worded in config_faults.py.
"""

import os
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    PositiveFloat,
    PositiveInt,
    PrivateAttr,
    ValidationError,
    model_validator,
)

from common.config_environment import override
from common.config_faults import worded
from common.errors import BadInput
from common.keys import SceneKeys, identifier
from common.vocabulary import Vocabulary

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
    credentials: "", or the folder with this machine's ca.pem, certificate.pem and key.pem (docs/security.md).
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

    speed: what was recorded is played this much faster than it was; 0 is as fast as possible. model: "" until the
    scene is read, then a file name (by default ID.model). tracker: "auto" chooses by the source. rate_hz, size_px:
    what a camera is asked for. mirrored: the pictures are, as selfies are. skin, face: what `camshift` may be told of
    the person (a file; x, y, width, height in px). pose_model, hand: the model file of `mediapipe`, and what
    it takes for a hand. preview: a film to write of what it sees.
    """

    source: Annotated[str, Field(min_length=1)]
    view: Annotated[str, Field(min_length=1)] = "door"
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
    virtual: VirtualConfig = VirtualConfig()


class FusionConfig(Section):
    """[fusion]: how the referee judges; seconds and probabilities.

    quorum: least number of agreeing judges; in a scene that does not say, more than half of its observers.
    fresh_s, fade_s, drop_s: how an opinion ages; blind_s: how that of who sees nothing fades. step_hz: judgements per
    second at least. standby: ids of further fusion services, of which one takes over when the leading one is gone or
    silent for takeover_s. memory: a file in which the movement that goes on is kept over a restart; "": none.
    """

    id: str = "fusion"
    rule: str = "robust_inverse_entropy"
    quorum: Annotated[int, Field(ge=1)] = 1
    threshold: Annotated[float, Field(gt=0, le=1)] = 0.8
    hold_s: Annotated[float, Field(ge=0)] = 0.3
    fresh_s: Annotated[float, Field(ge=0)] = 0.2
    fade_s: PositiveFloat = 0.5
    blind_s: PositiveFloat = 0.15
    drop_s: PositiveFloat = 2.0
    step_hz: Annotated[float, Field(ge=0.1, le=1000)] = 10.0
    standby: Annotated[tuple[str, ...], Field(strict=False)] = ()
    takeover_s: PositiveFloat = 0.5
    memory: str = ""


class Scene(Section):
    """A whole scene. Made by `read_scene`, which also knows the folder that file names in it start from."""

    scene: str
    vocabulary: Annotated[tuple[str, ...], Field(strict=False)] | None = None
    vocabulary_name: str = "movements"
    mesh: MeshConfig = MeshConfig()
    observers: dict[str, ObserverConfig]
    fusion: FusionConfig = FusionConfig()
    _folder: Path = PrivateAttr(default=Path())

    @model_validator(mode="after")
    def _hangs_together(self) -> "Scene":
        _ = self.keys, self.named_vocabulary
        identifier(self.fusion.id, "fusion.id")
        for name in self.fusion.standby:
            identifier(name, "fusion.standby")
        if len(set(self.services)) != len(self.services):
            raise BadInput(f"fusion.standby = {list(self.fusion.standby)}: each service has an id of its own")
        for name in self.observers:
            identifier(name, "observers")
        if self.fusion.quorum > len(self.observers):
            raise BadInput(
                f"fusion.quorum = {self.fusion.quorum}: the scene has {len(self.observers)} observers, so many can "
                f"never agree; choose 1 to {len(self.observers)}"
            )
        return self

    @property
    def keys(self) -> SceneKeys:
        """Where on the mesh everything of this scene is said."""
        return SceneKeys(self.scene, self.mesh.prefix)

    @property
    def roster(self) -> tuple[str, ...]:
        """The observers' ids, in the file's order."""
        return tuple(self.observers)

    @property
    def services(self) -> tuple[str, ...]:
        """The ids of all fusion services of this scene; the first one is where a mesh of one machine meets."""
        return (self.fusion.id, *self.fusion.standby)

    def judged_by(self, service: str) -> "Scene":
        """The same scene as seen by one of its fusion services; raises BadInput that lists the known ones."""
        if service not in self.services:
            raise BadInput(
                f"fusion service {service!r}: not in the scene; known: {', '.join(self.services)}; "
                f'add it to [fusion] standby = ["{service}"]'
            )
        others = tuple(name for name in self.services if name != service)
        scene = self.model_copy(update={"fusion": self.fusion.model_copy(update={"id": service, "standby": others})})
        scene._folder = self._folder
        return scene

    @property
    def named_vocabulary(self) -> Vocabulary | None:
        """The vocabulary that the file names; None: the models bring it."""
        return None if self.vocabulary is None else Vocabulary(self.vocabulary, self.vocabulary_name)

    def observer(self, observer: str) -> ObserverConfig:
        """The section of one observer; raises BadInput that lists the known ones."""
        if observer not in self.observers:
            raise BadInput(f"observer {observer!r}: not in the scene; known: {', '.join(self.observers)}")
        return self.observers[observer]

    def place(self, name: str) -> Path:
        """Where a file named in the scene file is: relative names start from the scene file's folder."""
        return self._folder / Path(name).expanduser()


def read_scene(path: Path, environment: Mapping[str, str] | None = None) -> Scene:
    """The scene in the file at `path`, overridden by LABANMESH_... of `environment` (default: the process's).

    Raises BadInput, one line that names file, key, value and rule.
    """
    table = _table(path)
    override(table, Scene, os.environ if environment is None else environment)
    try:
        _fill_in(table)
        _place_credentials(table, path.absolute().parent)
        scene = Scene.model_validate(table)
    except ValidationError as error:
        raise BadInput(f"{path}: {worded(error, Scene)}") from None
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from None
    scene._folder = path.absolute().parent
    return scene


def _table(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"{path}: not TOML: {error}") from None
    except UnicodeDecodeError:
        raise BadInput(f"{path}: not UTF-8 text; a scene file is TOML") from None
    except OSError as error:
        raise BadInput(f"{path}: {(error.strerror or str(error)).lower()}; name a scene file (TOML)") from None


def _place_credentials(table: dict[str, Any], folder: Path) -> None:
    """The folder of credentials starts from the scene file's: [mesh] is handed on without the scene."""
    mesh = table.get("mesh")
    if isinstance(mesh, dict) and isinstance(named := mesh.get("credentials"), str) and named:
        mesh["credentials"] = str(folder / Path(named).expanduser())


def _fill_in(table: dict[str, Any]) -> None:
    """What the defaults cannot say because it depends on the rest of the file."""
    observers = table.get("observers")
    if not observers:
        raise BadInput('no observers: name at least one, e.g. [observers.cam1] with source = "motion.npz"')
    if not isinstance(observers, dict):
        return
    for name, section in observers.items():
        if isinstance(section, dict):
            section.setdefault("model", f"{name}.model")
    fusion = table.setdefault("fusion", {})
    if isinstance(fusion, dict):
        fusion.setdefault("quorum", len(observers) // 2 + 1)
