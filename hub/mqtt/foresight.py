"""Early words on their way to the broker: one event when a movement is named early, one when that has ended. Pure."""

import json
from collections.abc import Iterable

from hub.anticipation import Word
from hub.mqtt.names import Names
from hub.mqtt.picture import rounded
from hub.mqtt.verdicts import moment


def events_of(names: Names, words: Iterable[Word]) -> list[tuple[str, str]]:
    """Topic and payload of each; `event_type` is what the movement is held for now."""
    return [(names.early, json.dumps(_said(word), allow_nan=False)) for word in words]


def _said(word: Word) -> dict[str, object]:
    return {
        "event_type": word.label,
        "stage": word.stage,
        "early": word.early,
        "confidence": rounded(100 * word.p, 0),
        "id": word.id,
        "began": moment(word.began_ns),
        "said": moment(word.at_ns),
    }
