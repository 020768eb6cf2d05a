"""What Home Assistant shall show of a scene: its discovery messages, one for each entity. Pure.

Each component is discovered by itself, which every version since 2021 understands; `event` needs 2023.8.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from common.vocabulary import ABSTAIN
from hub.mqtt.facets import facet_sensors
from hub.mqtt.names import ORIGIN, Names

EXPIRE_S = 30
"""A movement that was not said to go on for so long is not known to."""
BITS = {"unit_of_measurement": "bit", "state_class": "measurement"}
PERCENT = {"unit_of_measurement": "%", "state_class": "measurement"}
SECONDS = {"unit_of_measurement": "s", "state_class": "measurement", "device_class": "duration"}
HERTZ = {"unit_of_measurement": "Hz", "state_class": "measurement", "device_class": "frequency"}


@dataclass(frozen=True, slots=True)
class Entity:
    """One entity: its component, the last part of its id in upper case, its name, and what else Home Assistant is told.

    observer: whose it is; "": the scene's own. availability: the topics that must all say `online`.
    """

    component: str
    what: str
    name: str
    more: dict[str, Any]
    availability: Sequence[str]
    observer: str = ""
    label: str = ""
    device: dict[str, Any] = field(default_factory=dict)

    def config(self, names: Names) -> tuple[str, str]:
        """Topic and payload of its discovery."""
        unique_id = names.entity(self.what, self.observer, self.label)
        said = {
            "name": self.name,
            "unique_id": unique_id,
            "has_entity_name": True,
            **self.more,
            "availability": [{"topic": topic} for topic in self.availability],
            "availability_mode": "all",
            "device": self.device,
            "origin": {"name": ORIGIN},
        }
        return names.config(self.component, unique_id), json.dumps(said)


def discovery(
    names: Names,
    observers: Sequence[str],
    labels: Sequence[str],
    movements: Sequence[str],
    area: str,
    facets: frozenset[str] = frozenset(),
    early: bool = False,
) -> dict[str, str]:
    """Topic and payload for each entity of the scene; verdicts have none while the `labels` are unknown.

    facets: those that somebody says. early: whether movements are named before they are decided.
    """
    found = [*_scene(names, movements, area, facets), *_events(names, labels, area, early)]
    found += [entity for observer in observers for entity in _observer(names, observer, area)]
    return dict(entity.config(names) for entity in found)


def _events(names: Names, labels: Sequence[str], area: str, early: bool) -> Iterator[Entity]:
    device = _device(names, names.scene, "scene", area)
    said = [
        ("VERDICT", "Verdict", names.verdict, "mdi:gavel"),
        ("ENDED", "Movement ended", names.ended, "mdi:flag-checkered"),
        *([("EARLY", "Early word", names.early, "mdi:crystal-ball")] if early else []),
    ]
    for what, name, topic, icon in said if labels else ():
        more = {"state_topic": topic, "icon": icon, "event_types": [*labels, ABSTAIN]}
        yield Entity("event", what, name, more, (names.bridge, names.availability), device=device)


def _scene(names: Names, movements: Sequence[str], area: str, facets: frozenset[str]) -> Iterator[Entity]:
    device = _device(names, names.scene, "scene", area)
    judged = (names.bridge, names.availability)

    def entity(component: str, what: str, name: str, more: dict[str, Any], label: str = "") -> Entity:
        return Entity(component, what, name, more, judged, label=label, device=device)

    votes = {"json_attributes_topic": names.votes}
    yield entity("sensor", "MOVEMENT", "Movement", {**_value(names.state, "movement"), **votes, "icon": "mdi:karate"})
    yield entity("sensor", "CONFIDENCE", "Confidence", _value(names.state, "confidence") | PERCENT)
    yield entity("sensor", "ENTROPY", "Entropy", _value(names.state, "entropy") | BITS)
    last = {"json_attributes_topic": names.last_verdict, "icon": "mdi:history"}
    yield entity("sensor", "LAST_VERDICT", "Last verdict", _value(names.last_verdict, "label") | last)
    for what, name, more in facet_sensors(names.facets, facets):
        yield entity("sensor", what, name, more)
    for label in movements:
        more = {"state_topic": names.movement(label), "expire_after": EXPIRE_S, "icon": "mdi:human-handsup"}
        yield entity("binary_sensor", "DOES", label.replace("_", " ").capitalize(), more, label)


def _observer(names: Names, observer: str, area: str) -> Iterator[Entity]:
    device = _device(names, f"{names.scene} {observer}", "observer", area, observer)
    there = (names.bridge, names.observer(observer, "availability"))
    diagnostic = {"entity_category": "diagnostic"}
    connected = {"state_topic": names.observer(observer, "connected"), "device_class": "connectivity", **diagnostic}
    # Whether it is connected is known as long as the hub is: it says off where all else is unavailable.
    yield Entity("binary_sensor", "CONNECTED", "Connected", connected, (names.bridge,), observer, device=device)
    health, state = names.observer(observer, "health"), names.observer(observer, "state")

    def sensor(what: str, name: str, topic: str, more: dict[str, Any]) -> Entity:
        return Entity("sensor", what, name, _value(topic, what.lower()) | more, there, observer, device=device)

    yield sensor("OPINION", "Opinion", health, {"icon": "mdi:flag"})
    yield sensor("STATE", "State", health, {**diagnostic, "json_attributes_topic": health})
    yield sensor("ENTROPY", "Entropy", state, BITS | diagnostic)
    yield sensor("WEIGHT", "Weight", state, PERCENT | diagnostic)
    yield sensor("RELIABILITY", "Reliability", state, {"state_class": "measurement"} | diagnostic)
    yield sensor("AGE", "Age", state, SECONDS | diagnostic)
    yield sensor("RATE", "Rate", state, HERTZ | diagnostic)
    yield sensor("SKEW", "Clock skew", state, SECONDS | diagnostic)
    yield sensor("REJECTED", "Rejected messages", state, {"state_class": "total_increasing"} | diagnostic)


def _device(names: Names, name: str, model: str, area: str, observer: str = "") -> dict[str, Any]:
    via = {"via_device": names.device()} if observer else {}
    suggested = {"suggested_area": area} if area else {}
    return {"identifiers": [names.device(observer)], "name": name, "manufacturer": "labanmesh", "model": model,
            **via, **suggested}  # fmt: skip


def _value(topic: str, field: str) -> dict[str, Any]:
    return {"state_topic": topic, "value_template": "{{ value_json." + field + " }}"}
