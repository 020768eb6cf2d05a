"""How a movement is done, for the broker: Effort, Shape and facing as states, and which of them somebody says. Pure."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from common.facets import EFFORT, FACETS, SHAPE
from common.messages import JudgementMessage
from hub.leanings import facing, leanings
from hub.mqtt.picture import rounded

FACING: Final = "facing"
ICONS: Mapping[str, str] = {
    "effort_time": "mdi:timer-outline",
    "effort_weight": "mdi:weight",
    "effort_space": "mdi:target",
    "effort_flow": "mdi:waves",
    "shape_horizontal": "mdi:arrow-left-right",
    "shape_vertical": "mdi:arrow-up-down",
    "shape_sagittal": "mdi:arrow-top-right-bottom-left",
}


def said_facets(judgement: JudgementMessage | None) -> frozenset[str]:
    """The facets that it says, FACING among them."""
    if judgement is None:
        return frozenset()
    turned = [] if facing(judgement.facing_deg) is None else [FACING]
    return frozenset([*(each.facet for each in leanings(judgement.facets)), *turned])


def facets_of(judgement: JudgementMessage) -> dict[str, Any] | None:
    """Each said facet with its pole and its probability in percent; None where none is said."""
    said = {each.facet: {"pole": each.value, "probability": round(100 * each.p)} for each in leanings(judgement.facets)}
    return said or None


def facing_of(judgement: JudgementMessage) -> float | None:
    """Which way the person faces, in whole degrees to the left."""
    whole = rounded(facing(judgement.facing_deg), 0)
    return None if whole is None else whole % 360


def facets_state(judgement: JudgementMessage, announced: frozenset[str]) -> dict[str, Any]:
    """The state of all that were announced; what is not said now is null in it."""
    silent = {"pole": None, "probability": None}
    said = facets_of(judgement) or {}
    state = {facet: said.get(facet, silent) for facet in FACETS if facet in announced}
    return state | ({FACING: facing_of(judgement)} if FACING in announced else {})


def facet_sensors(topic: str, announced: frozenset[str]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Of each announced facet: the last part of its id, its name, and what else Home Assistant is told."""
    for kinds in (EFFORT, SHAPE):
        yield from (_sensor(topic, facet, poles) for facet, poles in kinds.items() if facet in announced)
    if FACING in announced:
        value = "{{ value_json." + FACING + " }}"
        more = {"state_topic": topic, "value_template": value, "unit_of_measurement": "°", "icon": "mdi:compass"}
        yield FACING.upper(), "Facing", more


def _sensor(topic: str, facet: str, poles: Sequence[str]) -> tuple[str, str, dict[str, Any]]:
    more = {
        "state_topic": topic,
        # Of a word Home Assistant would take None for a word.
        "value_template": "{{ value_json." + facet + ".pole or 'unknown' }}",
        "json_attributes_topic": topic,
        "json_attributes_template": "{{ {'probability': value_json." + facet + ".probability} | tojson }}",
        "icon": ICONS[facet],
    }
    return facet.upper(), facet.replace("_", " ").capitalize(), more
