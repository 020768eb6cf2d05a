"""How often each repeated movement has been done, for Home Assistant: a sensor, a target, a reset, and an event. Pure.

A movement is repeated if its takes show it (its period is in the vocabulary). The target is that of one set; to set it
begins anew. After a restart of the hub the counts are 0; the targets are those that the broker has retained.
"""

import json
from typing import Any

from common.messages import JudgementMessage
from hub.counting.tally import RepetitionTally
from hub.mqtt.entities import COUNT_PARTS, Entity, Topics
from hub.mqtt.events import Publication
from hub.mqtt.states import FAST_S, RetainedState
from hub.scene_state import SceneState
from hub.wording import moment

LARGEST_TARGET = 1000


class Counters:
    """The tallies of one scene."""

    def __init__(self, topics: Topics) -> None:
        self._topics = topics
        self._tallies: dict[str, RepetitionTally] = {}
        self._since_ns: int | None = None
        self._reached: dict[str, int] = {}
        self._left: dict[str, int] = {}
        self.commands = (topics.count("+") + "/target", topics.count("+") + "/reset")
        """The topic filters under which people set a target and begin anew."""

    def recall(self, topic: str, payload: object) -> None:
        """Go on with the target in the state that an earlier hub has left under `topic`."""
        label = topic.removeprefix(self._topics.count(""))
        if label != topic and (target := _target_left(payload)) is not None:
            self._left[label] = target

    def take(self, message: JudgementMessage) -> None:
        """Take in a verdict or judgement that is no answer to a query."""
        self._since_ns = self._since_ns or message.at_ns
        for tally in self._tallies.values():
            tally.update(message)

    def follow(self, state: SceneState) -> list[Publication]:
        """Take in the newest judgement, and the vocabulary; returns an event for each target that is reached."""
        if state.vocabulary is not None and state.labels:
            repeated = state.vocabulary.vocabulary.periods
            self._tallies = {
                label: self._tallies.get(label)
                or RepetitionTally(label, self._left.get(label, 0), since_ns=self._since_ns)
                for label in repeated
            }
        if state.judgement is not None and not state.silent:
            self.take(state.judgement)
        events = []
        for label, tally in self._tallies.items():
            if tally.reached > self._reached.get(label, 0) and state.judgement is not None:
                fields = {"event_type": label, **self._fields(tally), "at": moment(state.judgement.at_ns)}
                events.append(Publication(self._topics.of("target"), json.dumps(fields), retain=False))
            self._reached[label] = tally.reached
        return events

    def obey(self, topic: str, payload: object) -> bool:
        """Carry out a command; whether it was one of this scene. A target that is no number changes nothing."""
        label, _, command = topic.removeprefix(self._topics.count("")).partition("/")
        tally = self._tallies.get(label) if topic.startswith(self._topics.count("")) else None
        if tally is None or command not in ("target", "reset"):
            return False
        if command == "reset":
            tally.reset()
        elif (target := _target_in(payload)) is not None:
            tally.reset(target)
        return True

    def retained(self, area: str) -> dict[str, RetainedState]:
        """The discovery messages and the states."""
        states = {}
        for label, tally in self._tallies.items():
            fields = self._fields(tally)
            states[self._topics.count(label)] = RetainedState(json.dumps(fields), fields["count"], FAST_S)
        entities = [entity for label in self._tallies for entity in self._entities(label)]
        for entity in (*entities, *([self._event()] if entities else [])):
            topic, payload = entity.discovery(self._topics, area)
            states[topic] = RetainedState(payload)
        return states

    @staticmethod
    def _fields(tally: RepetitionTally) -> dict[str, Any]:
        now = tally.now
        return {"count": now.done, "partial": now.partial, "target": now.target, "sets": now.sets}

    def _entities(self, label: str) -> list[Entity]:
        name, topic = label.replace("_", " ").capitalize(), self._topics.count(label)
        shown: dict[str, dict[str, Any]] = {
            "sensor": {
                "state_topic": topic, "value_template": "{{ value_json.count }}", "json_attributes_topic": topic,
                "state_class": "total", "icon": "mdi:counter",
            },
            "number": {
                "state_topic": topic, "value_template": "{{ value_json.target }}", "command_topic": f"{topic}/target",
                "min": 0, "max": LARGEST_TARGET, "mode": "box", "icon": "mdi:bullseye-arrow",
            },
            "button": {"command_topic": f"{topic}/reset", "icon": "mdi:restart"},
        }  # fmt: skip
        names = {"sensor": "count", "number": "target", "button": "reset"}
        return [
            Entity(component, what, f"{name} {names[component]}", shown[component], label=label)
            for component, what in COUNT_PARTS.items()
        ]

    def _event(self) -> Entity:
        settings = {
            "state_topic": self._topics.of("target"), "icon": "mdi:bullseye-arrow", "event_types": [*self._tallies],
        }  # fmt: skip
        return Entity("event", "TARGET", "Target reached", settings)


def _target_left(payload: object) -> int | None:
    try:
        target = json.loads(payload if isinstance(payload, (str, bytes)) else b"")["target"]
    except (ValueError, TypeError, LookupError, RecursionError):
        return None
    return target if type(target) is int and 0 <= target <= LARGEST_TARGET else None


def _target_in(payload: object) -> int | None:
    try:
        value = float(payload if isinstance(payload, (str, bytes)) else b"")
    except ValueError:
        return None
    return int(value) if 0 <= value <= LARGEST_TARGET else None
