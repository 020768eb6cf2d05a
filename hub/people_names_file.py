"""The names that users give the people of a scene, in a file beside the scene file, which all pages show.

Messages, MQTT and the history keep the ids of the scene file, so that a new name changes nothing that programs know.
"""

import json
import threading
from collections.abc import Mapping
from pathlib import Path

from pydantic import TypeAdapter

from common.config import Scene
from common.config_people import NAME_LIMIT
from common.errors import BadInput, LabanmeshError, reason_of
from common.files import read_text, replace_file

_NAMES = TypeAdapter(dict[str, str])


class PeopleNames:
    """The names by person, of those who have one. Safe for several threads.

    Raises BadInput for a damaged file, LabanmeshError for one that cannot be read.
    """

    def __init__(self, scene: Scene) -> None:
        self._ids, self._path = scene.people.ids, scene.place(f"{scene.scene}.people.json")
        self._changing = threading.Lock()
        self.names: Mapping[str, str] = _read(self._path) if scene.people.most > 1 else {}
        """Replaced as a whole by each change."""

    def rename(self, person: object, name: object) -> None:
        """Give a person of the scene a name; "" is the scene's own. Raises BadInput, or LabanmeshError if the file
        cannot be written."""
        if person not in self._ids:
            raise BadInput(f"person: one of {', '.join(self._ids)} is expected")
        if not isinstance(name, str) or not name.isprintable() or len(name) > NAME_LIMIT:
            raise BadInput(f"name: at most {NAME_LIMIT} printable characters are expected")
        with self._changing:
            names = {**self.names, str(person): name.strip()}
            names = {each: given for each, given in names.items() if given not in ("", each)}
            try:
                replace_file(self._path, json.dumps(names, ensure_ascii=False, indent=1).encode() + b"\n")
            except OSError as error:
                raise LabanmeshError(f"{self._path}: {reason_of(error)}; names of people are kept there") from None
            self.names = names


def _read(path: Path) -> dict[str, str]:
    try:
        return _NAMES.validate_json(read_text(path))
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise LabanmeshError(f"{path}: {reason_of(error)}") from None
    except ValueError:
        raise BadInput(f"{path}: no names of people; move it away, and they can be given anew") from None
