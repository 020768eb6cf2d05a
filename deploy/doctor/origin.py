"""Which values of a scene count, and where each came from: the file, the environment, or a default. Pure."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from common.config_input import PREFIX, Place

if TYPE_CHECKING:
    from common.config import Scene

ADDRESS = re.compile(r"([A-Za-z][\w+.-]*)://(.*)", re.DOTALL)
HOST = re.compile(r"(\[[0-9a-fA-F:.]+\]|[\w.-]+)(:\d+)?\Z")
DEFAULT, FILE = "default", "file"


@dataclass(frozen=True, slots=True)
class Setting:
    """One key that counts. value: as the file would have it. origin: "default", "file", or the variable's name."""

    key: str
    value: str
    origin: str


def settings(scene: "Scene", table: Mapping[str, Any], environment: Mapping[str, str]) -> list[Setting]:
    """Every key of `scene`, which was read from `table`, the file as TOML has it, and the environment.

    Of virtual cameras only what somebody set: most scenes have none.
    """
    found = []
    for place, value in _leaves(scene.model_dump()):
        variable = variable_of(place)
        origin = variable if variable in environment else FILE if _stands(table, place) else DEFAULT
        if origin == DEFAULT and "virtual" in place:
            continue
        found.append(Setting(".".join(place), _written(value), origin))
    return found


def variable_of(place: Place) -> str:
    """The environment variable that overrides the key at `place`."""
    return PREFIX + "_".join(place).upper().replace("-", "_")


def masked(text: str) -> str:
    """A value as it may be shown: of an address no more than scheme, host and port; all else may be a secret."""
    address = ADDRESS.fullmatch(text)
    if address is None:
        return text
    scheme, rest = address.groups()
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


def _stands(table: object, place: Place) -> bool:
    for part in place:
        if not isinstance(table, Mapping) or part not in table:
            return False
        table = table[part]
    return True


def _written(value: object) -> str:
    if value is None:
        return "not set"
    return json.dumps(masked(value) if isinstance(value, str) else value, ensure_ascii=False)
