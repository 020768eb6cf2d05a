"""How a fault in the scene file is told: one line with the key, the value, the rule and the nearest known key. Pure."""

import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from common.errors import BadInput
from common.text import nearest

VALUE_LIMIT = 60
"""Characters of a wrong value that are quoted."""


def worded(error: ValidationError, model: type[BaseModel]) -> str:
    """The first fault as one line, and how many more there are."""
    faults = error.errors(include_url=False)
    first = faults[0]
    where = tuple(str(part) for part in first["loc"])
    line = _line(first["type"], where, first["msg"], first.get("input"), model)
    return line if len(faults) == 1 else f"{line} ({len(faults) - 1} more)"


def plain(message: str) -> str:
    """pydantic's words without the words about pydantic."""
    words = (
        message.removeprefix("Value error, ").replace("Input should be", "must be").replace("a valid tuple", "a list")
    )
    return re.sub(r"a valid dictionary( or instance of \w+)?", "a table, as [section] begins one", words)


def element_model(annotation: object) -> type[BaseModel] | None:
    """The section that a key holds, alone or as a table of sections; None for a plain value."""
    for candidate in (annotation, *get_args(annotation)):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return None


def _line(kind: str, where: tuple[str, ...], message: str, value: object, model: type[BaseModel]) -> str:
    key = ".".join(where)
    if kind == "extra_forbidden":
        return f"{key}: unknown key; {nearest(where[-1], _known(where[:-1], model))}"
    if kind == "missing":
        return f"{key}: missing; this key has no default"
    quoted = repr(value)
    quoted = quoted if len(quoted) <= VALUE_LIMIT else f"{quoted[:VALUE_LIMIT]}..."
    return f"{key} = {quoted}: {plain(message)}"


def _known(where: tuple[str, ...], model: type[BaseModel]) -> list[str]:
    """The keys of the section at `where`; the names of a table of sections are skipped over."""
    for part in where:
        field = model.model_fields.get(part)
        model = (element_model(field.annotation) if field else None) or model
    return list(model.model_fields)


PREFIX = "LABANMESH_"
Place = tuple[str, ...]
Variable = tuple[str, tuple[Place, FieldInfo]]


def override(table: dict[str, Any], model: type[BaseModel], environment: Mapping[str, str]) -> None:
    """Write what the environment says into `table`, the scene file as read.

    Raises BadInput for a value of the wrong type and for a variable that begins as a section does but is no key.
    """
    known = dict(_variables(model, table))
    sections = tuple(
        f"{PREFIX}{name.upper()}_"
        for name, field in model.model_fields.items()
        if element_model(field.annotation) is not None
    )
    for variable in sorted(environment):
        if variable in known:
            place, field = known[variable]
            _write(table, place, _value(variable, environment[variable], field))
        elif variable.startswith(sections):
            raise BadInput(f"{variable}: unknown environment variable; {nearest(variable, known)}")


def _variables(
    model: type[BaseModel], table: object, place: Place = ()
) -> Iterator[tuple[str, tuple[Place, FieldInfo]]]:
    """Each legal variable's name with the place in the file it stands for."""
    for name, field in model.model_fields.items():
        inner = element_model(field.annotation)
        here = (*place, name)
        if inner is None:
            variable = PREFIX + "_".join(here).upper().replace("-", "_")
            yield variable, (here, field)
        elif isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from _variables(inner, {}, here)
        else:
            members = table.get(name) if isinstance(table, dict) else None
            for member in members if isinstance(members, dict) else ():
                yield from _variables(inner, {}, (*here, member))


def _value(variable: str, text: str, field: FieldInfo) -> object:
    listed = "tuple" in str(field.annotation)
    raw = [part.strip() for part in text.split(",")] if listed else text
    try:
        return TypeAdapter[object](field.rebuild_annotation()).validate_python(raw, strict=False)
    except ValidationError as error:
        raise BadInput(f"{variable} = {text!r}: {plain(error.errors()[0]['msg'])}") from None


def _write(table: dict[str, Any], place: Place, value: object) -> None:
    for part in place[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            return  # the file's own fault: the check of the whole names it
    table[place[-1]] = value
