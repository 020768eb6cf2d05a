"""The sections [history] and [notify.NAME] of a scene file: what the hub's machine keeps, and whom it tells. Pure."""

import re
from string import Formatter
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from common.config_sections import Section

TEMPLATE_FIELDS = ("what", "when", "sure", "scene", "label", "link")
URL = re.compile(r"https?://[^\s/?#]+(/\S*)?\Z")


def _url(value: str) -> str:
    if value and not URL.match(value):
        raise ValueError("must be http://HOST/PATH or https://HOST/PATH")
    return value


def _template(value: str) -> str:
    try:
        fields = {name for _, name, form, conversion in Formatter().parse(value) if name is not None}
        value.format_map(dict.fromkeys(TEMPLATE_FIELDS, ""))
    except (ValueError, KeyError, IndexError, AttributeError):
        fields = {""}
    if not fields <= set(TEMPLATE_FIELDS):
        raise ValueError(f"may hold {', '.join(f'{{{name}}}' for name in TEMPLATE_FIELDS)} and no other braces")
    return value


Url = Annotated[str, AfterValidator(_url)]
Preset = Literal["json", "ntfy", "gotify", "slack", "discord"]


class HistoryConfig(Section):
    """[history]: file: the SQLite file in which the hub's machine keeps verdicts and falls; "": none is kept.

    keep_days, keep_mb: what is older is deleted, and the oldest of more than this.
    """

    file: Annotated[str, Field(examples=["history.db"])] = ""
    keep_days: Annotated[float, Field(ge=1e-3, le=36_500)] = 365.0
    keep_mb: Annotated[float, Field(ge=1, le=1e6)] = 200.0


class NotifyConfig(Section):
    """[notify.NAME]: a webhook that is told of movements and falls (docs/guide/notify.md).

    url, or url_file for a secret one: where to. preset: what the receiver understands. labels: the movements, "*" for
    all. falls: whether falls are told. template: the text. page: the address of the dashboard, for the link.
    token_file: a file with the receiver's token. secret_file: with the key of the signature. cooldown_s: so long after
    a notification the same label is not told again. timeout_s: for the whole request. keep: how many wait at most.
    keep_hours: for how long.
    """

    url: Url = ""
    url_file: str = ""
    preset: Preset = "json"
    labels: Annotated[tuple[str, ...], Field(strict=False, examples=[["wave"]])] = ()
    falls: bool = True
    template: Annotated[str, AfterValidator(_template)] = "{what} at {when}, {sure}"
    page: Url = ""
    token_file: str = ""
    secret_file: str = ""
    cooldown_s: Annotated[float, Field(ge=0, le=86_400)] = 60.0
    timeout_s: Annotated[float, Field(ge=0.1, le=300)] = 10.0
    keep: Annotated[int, Field(ge=1, le=100_000)] = 1000
    keep_hours: Annotated[float, Field(ge=0.01, le=8760)] = 24.0
