"""Keys: where on the mesh everything of a scene is said (docs/reference/wire.md)."""

import re
from dataclasses import dataclass

from common.errors import BadInput

IDENTIFIER = re.compile(r"[a-z0-9_-]{1,64}\Z")


def identifier(value: str, what: str) -> str:
    """`value` if it is legal in Zenoh, MQTT and Home Assistant at once; raises BadInput that names `what`."""
    if not IDENTIFIER.match(value):
        raise BadInput(f"{what} = {value!r}: 1 to 64 characters of a-z, 0-9, _ and - are allowed")
    return value


@dataclass(frozen=True, slots=True)
class SceneKeys:
    """All keys of one scene; raises BadInput for a scene or prefix that is no legal key."""

    scene: str
    prefix: str = "laban"

    def __post_init__(self) -> None:
        identifier(self.scene, "scene")
        for part in self.prefix.split("/"):
            identifier(part, "mesh.prefix")

    @property
    def root(self) -> str:
        """The key below which everything of the scene lies."""
        return f"{self.prefix}/{self.scene}"

    def posterior(self, observer: str = "*") -> str:
        """Where an observer says what it believes; `*` for all of them."""
        return f"{self.root}/observer/{observer}/posterior"

    def observer_status(self, observer: str = "*") -> str:
        """Where an observer says how it is."""
        return f"{self.root}/observer/{observer}/status"

    def observer_alive(self, observer: str = "*") -> str:
        """The observer's liveliness token."""
        return f"{self.root}/observer/{observer}/alive"

    def fusion_status(self, fusion: str = "*") -> str:
        """Where a fusion service says how it is."""
        return f"{self.root}/fusion/{fusion}/status"

    def fusion_alive(self, fusion: str = "*") -> str:
        """The fusion service's liveliness token."""
        return f"{self.root}/fusion/{fusion}/alive"

    def fusion_handover(self, fusion: str = "*") -> str:
        """Where a fusion service that judges is asked to let the asker go on."""
        return f"{self.root}/fusion/{fusion}/handover"

    @property
    def judgement(self) -> str:
        """Where fusion says what the judges together believe, at every step."""
        return f"{self.root}/judgement"

    @property
    def verdict(self) -> str:
        """Where fusion says what was done: one event per movement."""
        return f"{self.root}/verdict"

    @property
    def vocabulary(self) -> str:
        """Where the names of the movements are said."""
        return f"{self.root}/vocabulary"


def scene_of(key: str) -> str:
    """The scene in a key below `observer` or `fusion`: `laban/<scene>/observer/cam1/posterior` -> `<scene>`."""
    return key.rsplit("/", 4)[-4]


def observer_of(key: str) -> str:
    """The observer's id in one of its keys: `.../observer/<id>/posterior` -> `<id>`."""
    return key.rsplit("/", 2)[-2]
