"""Input to the scene file's models: overrides from the environment, and validation errors as one line. Pure.

An environment variable LABANMESH_<SECTION>_<KEY> overrides a key: LABANMESH_SCENE, LABANMESH_MESH_ENDPOINT,
LABANMESH_OBSERVERS_CAM1_SPEED. Lists are separated by commas; a `-` in an observer's id is a `_` in the variable.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from common.errors import BadInput
from common.text import nearest

PREFIX = "LABANMESH_"
VALUE_LIMIT = 60
"""Characters of a wrong value that are quoted."""
Place = tuple[str, ...]


def describe_fault(error: ValidationError, model: type[BaseModel]) -> str:
    """One line for the most useful fault: key, value, rule and the nearest known key; and how many more there are.

    An unknown key comes first, because it is often the misspelled one that is reported as missing.
    """
    faults = error.errors(include_url=False)
    first = min(faults, key=lambda fault: fault["type"] != "extra_forbidden")
    line = _line(first["type"], tuple(map(str, first["loc"])), first["msg"], first.get("input"), model)
    return line if len(faults) == 1 else f"{line} ({len(faults) - 1} more)"


def override(table: dict[str, Any], model: type[BaseModel], environment: Mapping[str, str]) -> None:
    """Write the overrides in `environment` into `table`, the scene file as parsed.

    Raises BadInput for a value of the wrong type, and for a variable that starts like a section but names no key.
    """
    known = dict(_variables(model, table))
    sections = tuple(
        f"{PREFIX}{name.upper()}_" for name, field in model.model_fields.items() if _section(field.annotation)
    )
    for variable in sorted(environment):
        if variable in known:
            place, field = known[variable]
            _write(table, place, _value(variable, environment[variable], field))
        elif variable.startswith(sections):
            raise BadInput(f"{variable}: unknown environment variable; {nearest(variable, known)}")


def _line(kind: str, place: Place, message: str, value: object, model: type[BaseModel]) -> str:
    key = ".".join(place)
    if kind == "extra_forbidden":
        return f"{key}: unknown key; {nearest(place[-1], _known_keys(place[:-1], model))}"
    if kind == "missing":
        return f"{key}: missing; this key has no default"
    quoted = repr(value)
    quoted = quoted if len(quoted) <= VALUE_LIMIT else f"{quoted[:VALUE_LIMIT]}..."
    return f"{key} = {quoted}: {_rule(message)}"


def _rule(message: str) -> str:
    """A message of pydantic in the words of the scene file."""
    rule = message.removeprefix("Value error, ").replace("Input should be", "must be").replace("valid tuple", "list")
    return re.sub(r"a valid dictionary( or instance of \w+)?", "a table, which starts with [section]", rule)


def _known_keys(place: Place, model: type[BaseModel]) -> list[str]:
    """The keys of the section at `place`, in which the names of a table of sections are skipped."""
    for part in place:
        field = model.model_fields.get(part)
        model = (_section(field.annotation) if field else None) or model
    return list(model.model_fields)


def _section(annotation: object) -> type[BaseModel] | None:
    """The model of a section, or of each section in a table; None for a plain value."""
    for candidate in (annotation, *get_args(annotation)):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return None


def _variables(
    model: type[BaseModel], table: object, place: Place = ()
) -> Iterator[tuple[str, tuple[Place, FieldInfo]]]:
    """Each environment variable that overrides a key, with the key's place and field."""
    for name, field in model.model_fields.items():
        section = _section(field.annotation)
        here = (*place, name)
        if section is None:
            yield PREFIX + "_".join(here).upper().replace("-", "_"), (here, field)
        elif isinstance(field.annotation, type):
            yield from _variables(section, {}, here)
        else:
            members = table.get(name) if isinstance(table, dict) else None
            for member in members if isinstance(members, dict) else ():
                yield from _variables(section, {}, (*here, member))


def _value(variable: str, text: str, field: FieldInfo) -> object:
    is_list = "tuple" in str(field.annotation)
    raw = [part.strip() for part in text.split(",")] if is_list else text
    try:
        return TypeAdapter[object](field.rebuild_annotation()).validate_python(raw, strict=False)
    except ValidationError as error:
        raise BadInput(f"{variable} = {text!r}: {_rule(error.errors()[0]['msg'])}") from None


def _write(table: dict[str, Any], place: Place, value: object) -> None:
    for part in place[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            return  # the file has a value where a section belongs: validation reports it
    table[place[-1]] = value
