"""The settings of a scene that are in force, and where each came from: the file, the environment, a default. Pure."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from common.config_input import PREFIX, Place

if TYPE_CHECKING:
    from common.config import Scene

URL = re.compile(r"([A-Za-z][\w+.-]*)://(.*)", re.DOTALL)
HOST = re.compile(r"(\[[0-9a-fA-F:.]+\]|[\w.-]+)(:\d+)?\Z")
DEFAULT, FILE = "default", "file"


@dataclass(frozen=True, slots=True)
class EffectiveSetting:
    """One key. value: as the file would have it. origin: "default", "file", or the environment variable's name."""

    key: str
    value: str
    origin: str


def settings_in_force(
    scene: "Scene", table: Mapping[str, Any], environment: Mapping[str, str]
) -> list[EffectiveSetting]:
    """Every key of `scene`, which was read from `table`, the file as TOML has it, and the environment.

    Of virtual cameras only the keys that somebody set: most scenes have none.
    """
    settings = []
    for place, value in _leaves(scene.model_dump()):
        variable = PREFIX + "_".join(place).upper().replace("-", "_")
        origin = variable if variable in environment else FILE if _is_set(table, place) else DEFAULT
        if origin != DEFAULT or "virtual" not in place:
            settings.append(EffectiveSetting(".".join(place), _as_written(value), origin))
    return settings


def masked(text: str) -> str:
    """A value as it may be shown: of a URL only scheme, host and port; the rest may hold a secret."""
    url = URL.fullmatch(text)
    if url is None:
        return text
    scheme, rest = url.groups()
    authority = re.split(r"[/?#]", rest, maxsplit=1)[0]
    host, behind = authority.rpartition("@")[2], rest[len(authority) :]
    if "@" in behind or not HOST.match(host):
        return f"{scheme}://..."
    return f"{scheme}://{host}{'/...' if len(behind) > 1 else behind}"


def _leaves(table: Mapping[str, Any], place: Place = ()) -> Iterator[tuple[Place, object]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, (*place, name))
        else:
            yield (*place, name), value


def _is_set(table: object, place: Place) -> bool:
    for part in place:
        if not isinstance(table, Mapping) or part not in table:
            return False
        table = table[part]
    return True


def _as_written(value: object) -> str:
    if value is None:
        return "not set"
    return json.dumps(masked(value) if isinstance(value, str) else value, ensure_ascii=False)
