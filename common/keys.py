"""Keys of a scene on the mesh (docs/reference/wire.md). Pure."""

import re
from dataclasses import dataclass

from common.errors import BadInput

IDENTIFIER = re.compile(r"[a-z0-9_-]{1,64}\Z")


def identifier(value: str, what: str) -> str:
    """`value` if it is legal in Zenoh, MQTT and Home Assistant; raises BadInput that names `what` it is."""
    if not IDENTIFIER.match(value):
        raise BadInput(f"{what} = {value!r}: 1 to 64 characters of a-z, 0-9, _ and - are allowed")
    return value


@dataclass(frozen=True, slots=True)
class SceneKeys:
    """All keys of one scene; raises BadInput for a scene or prefix that is not a legal key."""

    scene: str
    prefix: str = "laban"

    def __post_init__(self) -> None:
        identifier(self.scene, "scene")
        for part in self.prefix.split("/"):
            identifier(part, "mesh.prefix")

    @property
    def root(self) -> str:
        """The prefix of all keys of the scene."""
        return f"{self.prefix}/{self.scene}"

    def posterior(self, observer: str = "*") -> str:
        """Posteriors of an observer; `*` for all of them."""
        return f"{self.root}/observer/{observer}/posterior"

    def observer_status(self, observer: str = "*") -> str:
        """Status of an observer."""
        return f"{self.root}/observer/{observer}/status"

    def observer_alive(self, observer: str = "*") -> str:
        """Liveliness token of an observer."""
        return f"{self.root}/observer/{observer}/alive"

    def posture(self, observer: str = "*") -> str:
        """What an observer sees of the person's posture, if the scene watches for falls."""
        return f"{self.root}/observer/{observer}/posture"

    def picture(self, observer: str = "*") -> str:
        """Live pictures of an observer. No wildcard of Zenoh covers a part that begins with @: only `@picture` does.

        So a listener to the whole scene, as `capture` is, never receives a picture.
        """
        return f"{self.root}/observer/{observer}/@picture"

    def teach(self, observer: str = "*") -> str:
        """Requests to teach an observer. No wildcard of Zenoh covers a part that begins with @."""
        return f"{self.root}/observer/{observer}/@teach"

    def tracks(self, observer: str = "*") -> str:
        """What a phone tracks for an observer. No wildcard of Zenoh covers a part that begins with @."""
        return f"{self.root}/observer/{observer}/@tracks"

    def fusion_status(self, fusion: str = "*") -> str:
        """Status of a fusion service."""
        return f"{self.root}/fusion/{fusion}/status"

    def fusion_alive(self, fusion: str = "*") -> str:
        """Liveliness token of a fusion service."""
        return f"{self.root}/fusion/{fusion}/alive"

    def fusion_handover(self, fusion: str = "*") -> str:
        """Queries to the active fusion service to hand over to the sender."""
        return f"{self.root}/fusion/{fusion}/handover"

    def hub_alive(self, kind: str) -> str:
        """Liveliness token of a hub that does its work: `mqtt` while it is connected to its broker."""
        return f"{self.root}/hub/{kind}/alive"

    @property
    def judgement(self) -> str:
        """Judgements: the pooled posterior of every step, with short votes."""
        return f"{self.root}/judgement"

    @property
    def votes(self) -> str:
        """Judgements with full votes, published while somebody subscribes to them."""
        return f"{self.root}/votes"

    @property
    def verdict(self) -> str:
        """Verdicts: the events of each movement."""
        return f"{self.root}/verdict"

    @property
    def fall(self) -> str:
        """Whether somebody has fallen, if the scene watches for it."""
        return f"{self.root}/fall"

    @property
    def vocabulary(self) -> str:
        """The labels of the movements."""
        return f"{self.root}/vocabulary"


def scene_of(key: str) -> str:
    """The scene in a key of a process: `laban/<scene>/observer/cam1/posterior` -> `<scene>`."""
    return key.rsplit("/", 4)[-4]


def observer_of(key: str) -> str:
    """The id of the observer or fusion service in one of its keys: `.../observer/<id>/posterior` -> `<id>`."""
    return key.rsplit("/", 2)[-2]
