"""From scene files to what a hub passes on: which topics, which observers, which movements. Pure."""

from typing import TYPE_CHECKING

from common.errors import BadInput
from hub.mqtt.bridge import SceneBridge
from hub.mqtt.names import Names

if TYPE_CHECKING:
    from collections.abc import Sequence

    from common.config import Scene


def names_of(scene: "Scene", bridge: str) -> Names:
    """The topics and ids of `scene`, whose hub speaks under `bridge`."""
    return Names(scene.scene, bridge, scene.hub.mqtt.topics, scene.hub.mqtt.discovery)


def bridge_of(scene: "Scene", bridge: str) -> SceneBridge:
    """What passes on `scene`, whose hub speaks under `bridge`; raises BadInput for movements that it does not have."""
    asked, named = scene.hub.mqtt, scene.named_vocabulary
    for label in asked.movements if named else ():
        if named and label not in named.labels:
            raise BadInput(
                f"hub.mqtt.movements: {label!r} is no movement of {scene.scene}; known: {', '.join(named.labels)}"
            )
    step_s = 1 / scene.fusion.step_hz
    certainty = scene.hub.certainty
    return SceneBridge(names_of(scene, bridge), scene.roster, asked.movements, asked.area, step_s, certainty)


def require_one_broker(scenes: "Sequence[Scene]") -> None:
    """Raises BadInput when the scenes of one hub name several brokers, or have one name."""
    own = {"movements": (), "area": ""}
    first = scenes[0]
    for scene in scenes[1:]:
        if scene.hub.mqtt.model_copy(update=own) != first.hub.mqtt.model_copy(update=own):
            raise BadInput(f"{scene.scene}: its [hub.mqtt] is not that of {first.scene}; start a hub for each broker")
    names = [scene.scene for scene in scenes]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BadInput(f"scene {twice[0]!r}: two of the scene files have this name; each scene has its own")
