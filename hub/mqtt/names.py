"""Topics and ids of one scene at a broker, the same after every restart. Pure.

1. Ids of scenes and observers are lower case, what stands between them is upper case: no two of them can meet.
2. All topics of a scene lie below one; what Home Assistant shall discover lies below its own prefix.
"""

import re
from dataclasses import dataclass

from common.errors import BadInput

TOPIC = re.compile(r"[a-zA-Z0-9_-]+(/[a-zA-Z0-9_-]+)*\Z")
ORIGIN = "labanmesh"
"""By this word in an entity's origin we know our own."""


def prefix(value: str, key: str) -> str:
    """`value` if it can begin a topic; raises BadInput that names the scene file's `key`."""
    if not TOPIC.match(value):
        raise BadInput(
            f"{key} = {value!r}: parts of a-z, A-Z, 0-9, _ and -, with / between them; leave it out for {OWN[key]!r}"
        )
    return value


OWN = {"hub.mqtt.discovery": "homeassistant", "hub.mqtt.topics": "labanmesh"}


@dataclass(frozen=True, slots=True)
class Names:
    """All topics and ids of `scene`, whose hub says under `bridge` whether it is connected."""

    scene: str
    bridge: str
    topics: str = "labanmesh"
    discovery: str = "homeassistant"

    @property
    def root(self) -> str:
        """The topic below which everything of the scene lies."""
        return f"{self.topics}/{self.scene}"

    @property
    def availability(self) -> str:
        """`online` while the scene is judged."""
        return f"{self.root}/availability"

    @property
    def state(self) -> str:
        """JSON: what goes on now."""
        return f"{self.root}/state"

    @property
    def votes(self) -> str:
        """JSON: how each observer is heard now."""
        return f"{self.root}/votes"

    @property
    def verdict(self) -> str:
        """JSON, an event: what was done, when it is decided."""
        return f"{self.root}/verdict"

    @property
    def ended(self) -> str:
        """JSON, an event: what was done, when it has ended."""
        return f"{self.root}/ended"

    @property
    def early(self) -> str:
        """JSON, an event: what is done, before it is decided; and later whether that was right."""
        return f"{self.root}/early"

    @property
    def facets(self) -> str:
        """JSON: how it is done."""
        return f"{self.root}/facets"

    @property
    def last_verdict(self) -> str:
        """JSON: the newest verdict, which is also what the hub remembers over a restart."""
        return f"{self.root}/last_verdict"

    def movement(self, label: str) -> str:
        """`ON` while this movement goes on and is decided."""
        return f"{self.root}/movement/{label}"

    def observer(self, observer: str, what: str) -> str:
        """One of an observer's: availability, connected, health, state."""
        return f"{self.root}/observer/{observer}/{what}"

    def device(self, observer: str = "") -> str:
        """The id of the scene's device, or of an observer's."""
        return f"labanmesh_{self.scene}" + (f"_OBSERVER_{observer}" if observer else "")

    def entity(self, what: str, observer: str = "", label: str = "") -> str:
        """The unique id of an entity, `what` in upper case."""
        return f"{self.device(observer)}_{what}" + (f"_{label}" if label else "")

    def config(self, component: str, unique_id: str) -> str:
        """Where Home Assistant looks for an entity."""
        return f"{self.discovery}/{component}/{unique_id}/config"


def bridge_topic(topics: str, first_scene: str) -> str:
    """Where a hub of several scenes says whether it is connected, by the first of them."""
    return f"{topics}/{first_scene}/bridge"


def client_id(first_scene: str) -> str:
    """Who the hub is at the broker."""
    return f"labanmesh-hub-{first_scene}"
