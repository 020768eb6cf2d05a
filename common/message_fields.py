"""Messages as plain maps, as they are packed: which fields are left out, and what a short judgement has. Pure."""

from typing import Any

from msgspec import to_builtins

from common.message_types import MessagePart
from common.messages import AnyMessage, JudgementMessage, PosteriorMessage, VerdictMessage

SENT_AS_NULL = frozenset({"ended_ns"})
"""Fields whose None is information (the movement has not ended) and is sent as null."""
SHORT_VOTE_OPTIONAL = (
    "rest", "skew_s", "unlearned", "reliability", "rest_reliability", "label_reliability", "root_p", "repetitions",
)  # fmt: skip
"""The fields that a short vote has unless they are null; five others it always has."""
SELDOM_SENT = (
    "rest_reliability", "label_reliability", "freshness", "repetitions", "repeated", "shortest_s", "rest_s", "period_s",
)  # fmt: skip
"""Fields of a full vote, and of a movement's durations, that are left out where they are null."""


def fields_of(message: AnyMessage, short: bool = False) -> dict[str, Any]:
    """What is sent of `message`; its parts are still objects. short: a judgement with short votes."""
    if isinstance(message, PosteriorMessage):
        # The most frequent message: fields with their default value are omitted too.
        fields: dict[str, Any] = to_builtins(message, enc_hook=part_of)
        return fields
    values = vars(message)
    fields = {name: value for name, value in values.items() if value is not None or name in SENT_AS_NULL}
    if not fields.get("movements", True):
        del fields["movements"]
    if short:
        fields["votes"] = {observer: _short_vote(vars(vote)) for observer, vote in values["votes"].items()}
        if values["movement"] is not None:
            movement = vars(values["movement"]).items()
            fields["movement"] = {name: value for name, value in movement if value is not None}
        # As maps they are packed without a call of `part_of`.
        fields["vocabulary"], fields["agreement"] = vars(values["vocabulary"]), vars(values["agreement"])
    return fields


def _short_vote(values: dict[str, Any]) -> dict[str, Any]:
    # By name and not in a loop: with four observers this is a quarter of what a judgement costs to encode.
    fields = {
        "label": values["label"],
        "entropy": values["entropy"],
        "weight": values["weight"],
        "age_s": values["age_s"],
        "state": values["state"],
    }
    for name in SHORT_VOTE_OPTIONAL:
        value = values[name]
        if value is not None:
            fields[name] = value
    # Beside `root_p` no reliability is full reliability.
    if values["root_p"] is not None and values["reliability"] == 1.0:
        del fields["reliability"]
    return fields


def is_short(message: AnyMessage) -> bool:
    """Whether it is a judgement whose votes have `root_p`."""
    # A verdict, one per movement, has full votes.
    if not isinstance(message, JudgementMessage) or isinstance(message, VerdictMessage):
        return False
    return any(vote.root_p is not None for vote in message.votes.values())


def part_of(part: MessagePart) -> dict[str, Any]:
    """All fields of a part of a message, null or not, but for `root_p` and those that are seldom sent."""
    values = vars(part).items()
    return {name: value for name, value in values if name != "root_p" and not (value is None and name in SELDOM_SENT)}


def leave_out(fields: dict[str, Any], detail: tuple[str, ...]) -> bool:
    """Remove a detail from `fields`; whether it was there. A vote keeps it as null, unless it is seldom sent."""
    name, *inner = detail
    if not inner:
        return fields.pop(name, None) is not None
    parts = [part for part in fields.get(name, {}).values() if part.get(inner[0]) is not None]
    for part in parts:
        part[inner[0]] = None
        if inner[0] in SELDOM_SENT:
            del part[inner[0]]
    return bool(parts)
