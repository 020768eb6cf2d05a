"""The rules of the supervisor for the files of an app, as of supervisor/apps/validate.py and options.py (May 2026).
Written anew from home-assistant/supervisor (Apache-2.0), for the keys that our app uses. Stricter: unknown keys, which
the supervisor drops in silence, are faults, and so are keys that repeat a default (as in
frenck/action-addon-linter)."""

import re
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

SCHEMA_ELEMENT = re.compile(
    r"(bool|email|url|port|device(\(subsystem=[a-z]+\))?|(str|password)(\(\d*,\d*\))?|int(\(-?\d*,-?\d*\))?"
    r"|float(\(-?[\d.]*,-?[\d.]*\))?|match\(.*\)|list\(.+\))\??\Z"
)
Element = Annotated[str, StringConstraints(pattern=SCHEMA_ELEMENT.pattern.replace(r"\Z", "$"))]
Elements = dict[str, Element]


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Mapped(Strict):
    type: Literal["addon_config", "homeassistant_config", "ssl", "share", "media", "backup", "data"]
    read_only: Literal[False]


class AppConfig(Strict):
    """config.yaml."""

    name: str
    version: Annotated[str, StringConstraints(pattern=r"^\d+\.\d+\.\d+$")]
    slug: Annotated[str, StringConstraints(pattern=r"^[-_.A-Za-z0-9]+$")]
    description: str
    arch: list[Literal["amd64", "aarch64"]]
    services: list[Annotated[str, StringConstraints(pattern=r"^(mqtt|mysql):(provide|want|need)$")]]
    video: Literal[True]
    map: list[Mapped]
    ports: dict[Annotated[str, StringConstraints(pattern=r"^\d+/(tcp|udp)$")], Annotated[int, Field(gt=0, lt=65536)]]
    ports_description: dict[str, str]
    webui: Annotated[str, StringConstraints(pattern=r"^(?:https?|\[PROTO:\w+\]):\/\/\[HOST\]:\[PORT:\d+\].*$")]
    options: dict[str, str | bool | list[dict[str, str]]]
    schema_: Annotated[dict[str, Element | list[Elements]], Field(alias="schema")]


class Translated(Strict):
    name: str
    description: str | None = None


class Translations(Strict):
    """translations/en.yaml."""

    configuration: dict[str, Translated]
    network: dict[str, str]


class Repository(Strict):
    """repository.yaml."""

    name: str
    maintainer: str


def fits(element, value):
    """Whether an option's value is allowed by its element of the schema; None: the option is left out."""
    if isinstance(element, list):
        return isinstance(value, list) and all(fits_all(element[0], each) for each in value)
    if value is None:
        return element.endswith("?")
    kind = element.removesuffix("?")
    if kind.startswith("match("):
        return isinstance(value, str) and re.match(kind[len("match(") : -1], value) is not None
    types = {"bool": bool, "port": int, "str": str, "password": str}
    return isinstance(value, types[kind.partition("(")[0]])


def fits_all(schema, options):
    """Whether all options are known and allowed, and none that is required is missing."""
    return set(options) <= set(schema) and all(fits(element, options.get(key)) for key, element in schema.items())
