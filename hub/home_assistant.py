"""Whether Home Assistant receives a scene, and what a person has to do next; shown by pages and commands. Pure."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from common.config import Scene

DEFAULT_HOST = "127.0.0.1"


@dataclass(frozen=True, slots=True)
class HomeAssistantAdvice:
    """connected: an MQTT hub of the scene is connected to its broker. state: one line; steps: what to do, in order."""

    connected: bool
    state: str
    steps: tuple[str, ...]


def home_assistant_advice(scene: "Scene", hubs: Collection[str]) -> HomeAssistantAdvice:
    """What to show about Home Assistant.

    hubs: the keys of liveliness tokens, as `link.presence(scene.keys.hub_alive("mqtt")).alive` has them.
    """
    return _connected(scene) if scene.keys.hub_alive("mqtt") in hubs else _not_connected(scene)


def _connected(scene: "Scene") -> HomeAssistantAdvice:
    steps = (
        "in Home Assistant, Settings > Automations & scenes > Blueprints, import those of labanmesh, once (its app has "
        "done so)",
        f"create an automation from it: as the trigger choose Device, {scene.scene}, and a movement, such as "
        f'"{_example(scene)} recognised"; then choose the lamp or the scene',
        "a movement that you teach from now on is offered there at once",
    )
    return HomeAssistantAdvice(True, f"Home Assistant can use the movements of {scene.scene}", steps)


def _not_connected(scene: "Scene") -> HomeAssistantAdvice:
    broker = scene.hub.mqtt
    is_configured = broker.host != DEFAULT_HOST or broker.port is not None or bool(broker.username)
    where = f"{broker.host}:{broker.port}" if broker.port else broker.host
    configure = (
        f"the scene file names the broker {where}; it must run there"
        if is_configured
        else 'in the scene file, under [hub.mqtt]: host = "homeassistant.local", username and password_file'
    )
    steps = (
        "in Home Assistant install the app Mosquitto broker, and add the integration MQTT",
        configure,
        'start the hub: labanmesh hub mqtt SCENE, or start = ["mqtt"] under [hub] and labanmesh up SCENE',
    )
    return HomeAssistantAdvice(False, f"no MQTT hub of {scene.scene} is connected to a broker", steps)


def _example(scene: "Scene") -> str:
    vocabulary = scene.named_vocabulary
    return vocabulary.labels[0].replace("_", " ") if vocabulary else "wave"
