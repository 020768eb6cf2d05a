"""The scene file: one TOML file that describes a scene and that all its processes read (docs/reference/scene.md).

config_*.py hold the sections, config_input.py the environment's overrides and the text of errors.
"""

import os
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, PrivateAttr, ValidationError, model_validator

from common.config_hub import EVERY_MOVEMENT, HistoryConfig, HubConfig, MqttConfig, NotifyConfig
from common.config_input import faults_of, override, without_faults
from common.config_people import PeopleConfig, WatchConfig
from common.config_sections import (
    FusionConfig,
    MeshConfig,
    MetricsConfig,
    ObserverConfig,
    PersonConfig,
    Section,
    TeachingConfig,
    default_quorum,
)
from common.errors import BadInput, Faults, noting, reason_of
from common.files import expand_home, read_toml
from common.keys import SceneKeys, identifier
from common.text import plural
from common.vocabulary import Vocabulary

__all__ = ["FusionConfig", "MeshConfig", "MqttConfig", "ObserverConfig", "Scene", "read_scene", "scene_files"]

MODELS_VARIABLE = "LABANMESH_MODELS"
"""Names a folder for taught models, where the scene file's own folder must not be written to."""


class Scene(Section):
    """A whole scene. `read_scene` makes it, and sets the folder that relative file names start from."""

    scene: Annotated[str, Field(examples=["dojo"])]
    vocabulary: Annotated[tuple[str, ...], Field(strict=False, examples=[["wave", "clap"]])] | None = None
    vocabulary_name: str = "movements"
    mesh: MeshConfig = MeshConfig()
    person: PersonConfig = PersonConfig()
    people: PeopleConfig = PeopleConfig()
    observers: dict[str, ObserverConfig]
    fusion: FusionConfig = FusionConfig()
    hub: HubConfig = HubConfig()
    teaching: TeachingConfig = TeachingConfig()
    metrics: MetricsConfig = MetricsConfig()
    watch: WatchConfig = WatchConfig()
    history: HistoryConfig = HistoryConfig()
    notify: dict[str, NotifyConfig] = Field(default_factory=dict)
    _folder: Path | None = PrivateAttr(default=None)
    _models: Path | None = PrivateAttr(default=None)
    _file: Path | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _is_consistent(self) -> "Scene":
        faults: list[str] = []
        names = {"fusion.id": (self.fusion.id,), "fusion.standby": self.fusion.standby}
        names |= {"observers": (*self.observers,), "notify": (*self.notify,)}
        checks: list[Callable[[], object]] = [lambda: self.keys, lambda: self.named_vocabulary]
        checks += [partial(identifier, name, what) for what, each in names.items() for name in each]
        checks.append(partial(self.watch.require_observers, self.observers))
        for check in checks:
            with noting(faults):
                check()
        faults += self._unfit()
        if faults:
            raise Faults(faults)
        return self

    def _unfit(self) -> Iterator[str]:
        """The faults of keys that do not fit each other."""
        if len(set(self.services)) != len(self.services):
            yield f"fusion.standby = {list(self.fusion.standby)}: give each service an id of its own"
        if not self.observers:
            yield 'no observers: name at least one, e.g. [observers.cam1] with source = "motion.npz"'
        known, wanted = self.vocabulary or (), {"fusion.periodic": self.fusion.periodic or ()}
        wanted["hub.mqtt.movements"] = tuple(each for each in self.hub.mqtt.movements if each != EVERY_MOVEMENT)
        for key, labels in wanted.items():
            for label in labels if known else ():
                if label not in known:
                    yield f"{key} = {label!r}: no movement of the vocabulary; known: {', '.join(known)}"
        for name, channel in self.notify.items():
            if bool(channel.url) == bool(channel.url_file):
                yield f"notify.{name}: needs url, or url_file with the name of a file that holds it"
        if self.fusion.quorum > len(self.observers) > 0:
            yield (
                f"fusion.quorum = {self.fusion.quorum}: the scene has {plural(len(self.observers), 'observer')}, and "
                f"no more can agree; choose {f'1 to {len(self.observers)}' if len(self.observers) > 1 else 1}"
            )

    @property
    def keys(self) -> SceneKeys:
        """The keys of this scene on the mesh."""
        return SceneKeys(self.scene, self.mesh.prefix)

    @property
    def roster(self) -> tuple[str, ...]:
        """The observers' ids, in the file's order."""
        return tuple(self.observers)

    @property
    def services(self) -> tuple[str, ...]:
        """The ids of all fusion services of this scene; on a mesh of one machine the first one listens."""
        return (self.fusion.id, *self.fusion.standby)

    def require_service(self, service: str, *, shared: bool = False) -> None:
        """Raises BadInput when the scene names its fusion services and `service` is not one of them.

        shared: a scene that names no standby services is one of several that any service may serve.
        """
        if service not in self.services and (self.fusion.standby or not shared):
            raise BadInput(
                f"fusion service {service!r}: not in the scene {self.scene!r}; known: {', '.join(self.services)}; "
                f'add it to [fusion] standby = ["{service}"]'
            )

    @property
    def named_vocabulary(self) -> Vocabulary | None:
        """The vocabulary that the file names; None if the observers' models bring it."""
        return None if self.vocabulary is None else Vocabulary(self.vocabulary, self.vocabulary_name)

    def observer(self, observer: str) -> ObserverConfig:
        """The section of one observer; raises BadInput that lists the known ones."""
        if observer not in self.observers:
            raise BadInput(f"observer {observer!r}: not in the scene; known: {', '.join(self.observers)}")
        return self.observers[observer]

    def person_for(self, observer: str) -> PersonConfig:
        """Where the model of `observer` expects the person: its own keys, else those of [person]."""
        own = self.observer(observer)
        place = self.person.place if own.place is None else own.place
        return PersonConfig(place=place, facing=self.person.facing if own.facing is None else own.facing)

    def place(self, name: str) -> Path:
        """The path of a file that the scene file names; relative names start from the scene file's folder."""
        return (self._folder or Path()) / expand_home(name)

    @property
    def has_folder(self) -> bool:
        """Whether the scene comes from a scene file, which lies in a folder."""
        return self._folder is not None

    @property
    def file(self) -> str:
        """The scene file as it was named, for a command that a person may copy."""
        return shlex.quote(str(self._file or "SCENE"))

    def taught_model(self, observer: str) -> Path:
        """Where teaching writes the model of `observer` and its takes: in the folder MODELS_VARIABLE, if set."""
        path = self.named_model(observer)
        return self._models / path.name if self._models else path

    def named_model(self, observer: str) -> Path:
        """The model of `observer` that the scene file names."""
        return self.place(self.observer(observer).model)

    def model_file(self, observer: str) -> Path:
        """The model of `observer`: what it was taught, else the file that the scene file names."""
        taught, in_scene = self.taught_model(observer), self.named_model(observer)
        return taught if taught.exists() or not in_scene.exists() else in_scene


def scene_files(paths: Sequence[Path]) -> Iterator[Path]:
    """The files among `paths`, and all *.toml of the folders; raises BadInput for a folder without any."""
    for path in paths:
        files = sorted(path.glob("*.toml")) if path.is_dir() else [path]
        if not files:
            raise BadInput(f"{path}: no scene file in this folder; scene files end in .toml")
        yield from files


def read_scene(path: Path, environment: Mapping[str, str] | None = None) -> Scene:
    """Read the scene file at `path`, overridden by LABANMESH_... in `environment` (default: the process's).

    Raises Faults: a line each that names file, key, value and rule; BadInput for what is not TOML.
    """
    table, environment = _parse(path), os.environ if environment is None else environment
    faults = override(table, Scene, environment)
    _set_defaults(table)
    _resolve_credentials(table, path.absolute().parent)
    try:
        scene = Scene.model_validate(table)
    except ValidationError as error:
        others = _inconsistencies(table, error)
        faults += [f"{path}: {line}" for line in dict.fromkeys([*faults_of(error, Scene), *others])]
    except Faults as error:
        faults += [f"{path}: {line}" for line in error.faults]
    if faults:
        raise Faults(faults, f"labanmesh doctor {shlex.quote(str(path))}")
    return _placed(scene, path, environment)


def sound_part(path: Path) -> Scene | None:
    """The scene; of a file that `read_scene` refuses, its observers, fusion rule and hubs, for further checks.

    Faulty keys then have their defaults; observers without a source are left out. None where nothing is left.
    """
    with suppress(BadInput):
        return read_scene(path)
    try:
        table = _parse(path)
    except BadInput:
        return None
    override(table, Scene, os.environ)
    sections = table.get("observers")
    observers = sections.items() if isinstance(sections, dict) else ()
    part: dict[str, Any] = {"scene": "scene", "people": table.get("people", {})}
    part["observers"] = {name: section for name, section in observers if _has_source(name, section)}
    for section, key in (("fusion", "rule"), ("hub", "start")):
        if isinstance(own := table.get(section), dict) and key in own:
            part[section] = {key: own[key]}
    for _ in range(3):
        _set_defaults(part)
        try:
            return _placed(Scene.model_validate(part), path, os.environ)
        except ValidationError as error:
            part = without_faults(part, error)
        except Faults:
            break
    return None


def _has_source(name: str, section: object) -> bool:
    with suppress(BadInput):
        identifier(name, "observers")
        return isinstance(section, dict) and isinstance(source := section.get("source"), str) and source != ""
    return False


def _placed(scene: Scene, path: Path, environment: Mapping[str, str]) -> Scene:
    """The scene with the folders that its file and the environment give it."""
    scene._folder, scene._file = path.absolute().parent, path
    models = environment.get(MODELS_VARIABLE)
    scene._models = expand_home(models) if models else None
    return scene


def _inconsistencies(table: Mapping[str, Any], error: ValidationError) -> Sequence[str]:
    """The faults of keys that do not fit each other, besides those of `error`; none where an observer is faulty as a
    whole, because their number is unknown."""
    lines: list[str] = []
    if any(fault["loc"][0] == "observers" and len(fault["loc"]) < 3 for fault in error.errors()):
        return lines
    for _ in range(3):  # first within the sections, then between them; a required key that is left out is missing
        table = without_faults(table, error)
        try:
            Scene.model_validate(table)
        except Faults as faults:
            return [*lines, *faults.faults]
        except ValidationError as again:
            error = again
            lines += faults_of(error, Scene, missing=False)
        else:
            break
    return lines


def _parse(path: Path) -> dict[str, Any]:
    try:
        table = read_toml(path)
    except FileNotFoundError as error:
        raise BadInput(f"{path}: {reason_of(error)}; name a scene file, or let `labanmesh init` write one") from None
    except OSError as error:
        raise BadInput(f"{path}: {reason_of(error)}; name a scene file (TOML)") from None
    except ValueError as error:
        raise BadInput(f"{path}: not TOML: {error}") from None
    if not table:
        raise BadInput(f"{path}: empty; `labanmesh init` writes a scene file")
    return table


def _resolve_credentials(table: dict[str, Any], folder: Path) -> None:
    """Make the folder of credentials absolute: [mesh] is passed on without the scene."""
    mesh = table.get("mesh")
    if isinstance(mesh, dict) and isinstance(name := mesh.get("credentials"), str) and name:
        mesh["credentials"] = str(folder / expand_home(name))


def _set_defaults(table: dict[str, Any]) -> None:
    """Set the defaults that depend on the rest of the file."""
    observers = table.setdefault("observers", {})
    if not isinstance(observers, dict):
        return
    for name, section in observers.items():
        if isinstance(section, dict):
            section.setdefault("model", f"{name}.model")
    fusion = table.setdefault("fusion", {})
    if isinstance(fusion, dict):
        fusion.setdefault("quorum", default_quorum(len(observers)))
