"""The scene file: one TOML file that describes a scene and that every process of it reads (docs/reference/scene.md).

What each section holds is in config_sections.py, which environment variables override it in config_environment.py, how
faults are worded in config_faults.py.
"""

import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, PrivateAttr, ValidationError, model_validator

from common.config_input import override, worded
from common.config_sections import (
    DashboardConfig,
    FusionConfig,
    HubConfig,
    MeshConfig,
    MetricsConfig,
    MqttConfig,
    ObserverConfig,
    Section,
    VirtualConfig,
    default_quorum,
)
from common.errors import BadInput
from common.keys import SceneKeys, identifier
from common.vocabulary import Vocabulary

__all__ = [
    "DashboardConfig",
    "FusionConfig",
    "HubConfig",
    "MeshConfig",
    "MetricsConfig",
    "MqttConfig",
    "ObserverConfig",
    "Scene",
    "VirtualConfig",
    "read_scene",
    "scene_files",
]


class Scene(Section):
    """A whole scene. Made by `read_scene`, which also knows the folder that file names in it start from."""

    scene: str
    vocabulary: Annotated[tuple[str, ...], Field(strict=False)] | None = None
    vocabulary_name: str = "movements"
    mesh: MeshConfig = MeshConfig()
    observers: dict[str, ObserverConfig]
    fusion: FusionConfig = FusionConfig()
    hub: HubConfig = HubConfig()
    metrics: MetricsConfig = MetricsConfig()
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

    def for_service(self, service: str) -> "Scene":
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

    def for_shared_service(self, service: str) -> "Scene":
        """The same as seen by one of the processes that share many scenes; raises BadInput for its id."""
        identifier(service, "fusion.id")
        scene = self.model_copy(update={"fusion": self.fusion.model_copy(update={"id": service})})
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


def scene_files(paths: Sequence[Path]) -> Iterator[Path]:
    """The files among `paths`, and all *.toml of the folders; raises BadInput for a folder without any."""
    for path in paths:
        if not path.is_dir():
            yield path
            continue
        inside = sorted(path.glob("*.toml"))
        if not inside:
            raise BadInput(f"{path}: no scene file in this folder; scene files end in .toml")
        yield from inside


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
        fusion.setdefault("quorum", default_quorum(len(observers)))
