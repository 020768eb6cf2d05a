"""Topics, ids and Home Assistant discovery messages of one scene; stable over restarts. Pure.

1. Ids of scenes and observers are lower case and what joins them is upper case, so that no two ids collide.
2. All topics of a scene lie below one root; discovery messages lie below Home Assistant's prefix.
3. Each component is discovered by itself, which every version since 2021 understands; `event` needs 2023.8.
4. Each movement is a device trigger, which a person picks in Home Assistant's editor: "wave recognised".
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

from common.facets import EFFORT, SHAPE
from common.vocabulary import ABSTAIN
from hub.anticipation import NEVER

if TYPE_CHECKING:
    from common.config import Scene

ORIGIN = "labanmesh"
"""The origin in our discovery messages, by which they are recognised."""
EXPIRE_S = 30
"""A movement's binary sensor becomes unknown when it is not repeated for this long."""
BITS = {"unit_of_measurement": "bit", "state_class": "measurement"}
PERCENT = {"unit_of_measurement": "%", "state_class": "measurement"}
IN_SECONDS = {"unit_of_measurement": "s", "state_class": "measurement", "device_class": "duration"}
HERTZ = {"unit_of_measurement": "Hz", "state_class": "measurement", "device_class": "frequency"}
FACING: Final = "facing"
DOES, RECOGNISED = "DOES", "RECOGNISED"
"""In the ids of a movement's binary sensor and device trigger."""
FIRST_WORD = "{{ value_json.event_type if value_json.stage == 'decided' else '' }}"
"""The movement of an event `verdict`, if it is the first word on it."""
COUNT_PARTS: Mapping[str, str] = {"sensor": "COUNT", "number": "TARGET", "button": "RESET"}
"""The entities that count a movement, and what each is in their ids."""
OF_MOVEMENTS = (("device_automation", RECOGNISED), ("binary_sensor", DOES), *COUNT_PARTS.items())
"""What a movement has of its own: component, and what it is in the ids."""
SceneTopic = Literal[
    "availability", "state", "votes", "facets", "verdict", "ended", "early", "last_verdict", "target", "fallen", "fall",
    "last_event", "person",
]  # fmt: skip
FACET_ICONS: Mapping[str, str] = {
    "effort_time": "mdi:timer-outline",
    "effort_weight": "mdi:weight",
    "effort_space": "mdi:target",
    "effort_flow": "mdi:waves",
    "shape_horizontal": "mdi:arrow-left-right",
    "shape_vertical": "mdi:arrow-up-down",
    "shape_sagittal": "mdi:arrow-top-right-bottom-left",
}


def bridge_topic(topics: str, first_scene: str) -> str:
    """Where a hub publishes whether it is connected; several scenes share the topic of the first."""
    return f"{topics}/{first_scene}/bridge"


@dataclass(frozen=True, slots=True)
class Topics:
    """All topics and ids of `scene`; `bridge` is the topic that shows whether its hub is connected.

    The payloads are described in docs/guide/home.md.
    """

    scene: str
    bridge: str
    topics: str = "labanmesh"
    discovery: str = "homeassistant"

    @property
    def root(self) -> str:
        """The topic below which everything of the scene lies."""
        return f"{self.topics}/{self.scene}"

    def of(self, name: SceneTopic, person: str = "") -> str:
        """One of the scene's topics; person: as `state`, of one of several people."""
        return f"{self.root}/{name}/{person}" if person else f"{self.root}/{name}"

    def movement(self, label: str) -> str:
        """`ON` from the decision to the end of this movement."""
        return f"{self.root}/movement/{label}"

    def count(self, label: str) -> str:
        """How often this movement has been done; below it the commands `target` and `reset`."""
        return f"{self.root}/count/{label}"

    @property
    def of_movements(self) -> tuple[str, ...]:
        """A topic filter for each kind of retained message that a movement has of its own; they end with its label."""
        kinds = (f"{self.discovery}/{component}/+/config" for component, _ in OF_MOVEMENTS)
        return *kinds, self.movement("+"), self.count("+")

    def is_of_movement(self, topic: str) -> bool:
        """Whether the retained message under `topic` belongs to one movement of this scene."""
        kinds = (self.config(*each, " ").partition(" ")[0] for each in OF_MOVEMENTS)
        return topic.startswith((*kinds, self.movement(""), self.count("")))

    def config(self, component: str, what: str, label: str = "", observer: str = "") -> str:
        """The topic of the discovery message of an entity, or of a device trigger."""
        return f"{self.discovery}/{component}/{self.unique_id(what, label, observer)}/config"

    def unique_id(self, what: str, label: str = "", observer: str = "") -> str:
        """The id of an entity."""
        return "_".join(filter(None, (self.device(observer), what, label)))

    def observer(self, observer: str, what: str) -> str:
        """One of an observer's topics: availability, connected, health, state."""
        return f"{self.root}/observer/{observer}/{what}"

    def device(self, observer: str = "") -> str:
        """The id of the scene's device, or of an observer's."""
        return f"labanmesh_{self.scene}" + (f"_OBSERVER_{observer}" if observer else "")


@dataclass(frozen=True, slots=True)
class Entity:
    """One entity. what: the last part of its id, upper case. settings: its other keys in the discovery message.

    observer: whose it is; "": the scene's. hub_alone: it needs the hub alone, else also its device.
    """

    component: str
    what: str
    name: str
    settings: dict[str, Any]
    observer: str = ""
    label: str = ""
    hub_alone: bool = False

    def discovery(self, topics: Topics, area: str) -> tuple[str, str]:
        """Topic and payload of its discovery message."""
        device = topics.observer(self.observer, "availability") if self.observer else topics.of("availability")
        payload = {
            "name": self.name,
            "unique_id": topics.unique_id(self.what, self.label, self.observer),
            "has_entity_name": True,
            **self.settings,
            "availability": [{"topic": each} for each in (topics.bridge, *([] if self.hub_alone else [device]))],
            "availability_mode": "all",
            "device": _device(topics, self.observer, area),
            "origin": {"name": ORIGIN},
        }
        return topics.config(self.component, self.what, self.label, self.observer), json.dumps(payload)


def _device(topics: Topics, observer: str, area: str) -> dict[str, Any]:
    ours = {"name": topics.scene, "model": "scene"}
    if observer:
        ours = {"name": f"{topics.scene} {observer}", "model": "observer", "via_device": topics.device()}
    suggested = {"suggested_area": area} if area else {}
    return {"identifiers": [topics.device(observer)], "manufacturer": "labanmesh", **ours, **suggested}


def discovery(
    topics: Topics,
    scene: "Scene",
    labels: Sequence[str],
    movements: Sequence[str],
    facets: frozenset[str] = frozenset(),
) -> dict[str, str]:
    """Topic and payload for each entity and device trigger of the scene; events and triggers need `labels`.

    movements: those with a binary sensor. facets: those that observers report.
    """
    area, people = scene.hub.mqtt.area, scene.people.ids if scene.people.most > 1 else ()
    entities = [*_scene(topics, movements, facets, people), *_events(topics, labels, scene.hub.certainty < NEVER)]
    entities += [] if scene.watch.fallen is None else _falls(topics)
    entities += [entity for observer in scene.roster for entity in _observer(topics, observer)]
    return dict([*(entity.discovery(topics, area) for entity in entities), *_triggers(topics, labels, area)])


def _triggers(topics: Topics, labels: Sequence[str], area: str) -> Iterator[tuple[str, str]]:
    for label in labels:
        payload = {
            "automation_type": "trigger",
            "type": RECOGNISED.lower(),
            "subtype": label.replace("_", " "),
            "topic": topics.of("verdict"),
            "value_template": FIRST_WORD,
            "payload": label,
            "qos": 1,
            "device": _device(topics, "", area),
            "origin": {"name": ORIGIN},
        }
        yield topics.config("device_automation", RECOGNISED, label), json.dumps(payload)


def _events(topics: Topics, labels: Sequence[str], early: bool) -> Iterator[Entity]:
    events: list[tuple[str, str, SceneTopic, str]] = [
        ("VERDICT", "Verdict", "verdict", "gavel"),
        ("ENDED", "Movement ended", "ended", "flag-checkered"),
        ("EARLY", "Early word", "early", "crystal-ball"),
    ]
    for what, name, topic, icon in events[: 2 + early] if labels else ():
        settings = {"state_topic": topics.of(topic), "icon": f"mdi:{icon}", "event_types": [*labels, ABSTAIN]}
        yield Entity("event", what, name, settings)


def _scene(topics: Topics, movements: Sequence[str], facets: frozenset[str], people: Sequence[str]) -> Iterator[Entity]:
    state, how = topics.of("state"), topics.of("facets")
    sensors = [
        ("MOVEMENT", "Movement", _word(state, "movement", topics.of("votes"), "karate")),
        ("CONFIDENCE", "Confidence", _value(state, "confidence") | PERCENT),
        ("ENTROPY", "Entropy", _value(state, "entropy") | BITS),
        ("LAST_VERDICT", "Last verdict", _word(last := topics.of("last_verdict"), "label", last, "history")),
        ("LAST_EVENT", "Last event", _word(last := topics.of("last_event"), "event", last, "timeline-clock-outline")),
        *((facet.upper(), _title(facet), _facet(how, facet)) for facet in (*EFFORT, *SHAPE) if facet in facets),
    ]
    if FACING in facets:
        compass = {"unit_of_measurement": "°", "icon": "mdi:compass"}
        sensors.append((FACING.upper(), "Facing", _value(how, FACING) | compass))
    yield from (Entity("sensor", *each) for each in sensors)
    for person in people:
        word = _word(topics.of("person", person), "movement", icon="account")
        yield Entity("sensor", "PERSON", f"Movement of {person}", word, label=person)
    for label in movements:
        settings = {"state_topic": topics.movement(label), "expire_after": EXPIRE_S, "icon": "mdi:human-handsup"}
        yield Entity("binary_sensor", DOES, _title(label), settings, label=label)


def _falls(topics: Topics) -> list[Entity]:
    """The alarm, which stays as it is while the watch is away: it may have been the last thing that was seen."""
    fall = topics.of("fall")
    alarm = {"state_topic": topics.of("fallen"), "device_class": "safety", "icon": "mdi:human-fall"}
    return [
        Entity("binary_sensor", "FALLEN", "Fallen", alarm | {"json_attributes_topic": fall}, hub_alone=True),
        Entity("sensor", "POSTURE", "Posture", _word(fall, "stage", icon="human"), hub_alone=True),
    ]


def _observer(topics: Topics, observer: str) -> Iterator[Entity]:
    diagnostic = {"entity_category": "diagnostic"}
    connected = {"state_topic": topics.observer(observer, "connected"), "device_class": "connectivity", **diagnostic}
    # It shows "off" when the observer's other entities are unavailable, so it depends on the hub alone.
    yield Entity("binary_sensor", "CONNECTED", "Connected", connected, observer, hub_alone=True)
    health, state = topics.observer(observer, "health"), topics.observer(observer, "state")
    yield Entity("sensor", "OPINION", "Opinion", _word(health, "opinion", icon="flag"), observer)
    yield Entity("sensor", "STATE", "State", _word(health, "state", health) | diagnostic, observer)
    numbers = [
        ("ENTROPY", "Entropy", BITS),
        ("WEIGHT", "Weight", PERCENT),
        ("RELIABILITY", "Reliability", {"state_class": "measurement"}),
        ("AGE", "Age", IN_SECONDS),
        ("RATE", "Rate", HERTZ),
        ("SKEW", "Clock skew", IN_SECONDS),
        ("REJECTED", "Rejected messages", {"state_class": "total_increasing"}),
    ]
    for what, name, settings in numbers:
        yield Entity("sensor", what, name, _value(state, what.lower()) | settings | diagnostic, observer)


def _title(name: str) -> str:
    return name.replace("_", " ").capitalize()


def _value(topic: str, field: str) -> dict[str, Any]:
    """A number of a JSON state; Home Assistant reads null as unknown."""
    return {"state_topic": topic, "value_template": "{{ value_json." + field + " }}"}


def _word(topic: str, field: str, attributes: str = "", icon: str = "") -> dict[str, Any]:
    """A word of a JSON state; Home Assistant would show null as the word "None"."""
    word = {"state_topic": topic, "value_template": "{{ value_json." + field + " or 'unknown' }}"}
    more = {"json_attributes_topic": attributes, "icon": icon and f"mdi:{icon}"}
    return word | {key: value for key, value in more.items() if value}


def _facet(topic: str, facet: str) -> dict[str, Any]:
    return _word(topic, f"{facet}.pole") | {
        "json_attributes_topic": topic,
        "json_attributes_template": "{{ {'probability': value_json." + facet + ".probability} | tojson }}",
        "icon": FACET_ICONS[facet],
    }
