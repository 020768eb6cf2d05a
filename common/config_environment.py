"""LABANMESH_<SECTION>_<KEY>: environment variables that override the scene file. Pure: the environment is passed in.

LABANMESH_SCENE, LABANMESH_MESH_ENDPOINT, LABANMESH_FUSION_RULE, LABANMESH_OBSERVERS_CAM1_SPEED; lists are
separated by commas; a `-` in an observer's id is a `_` in the variable.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from common.config_faults import element_model, nearest, plain
from common.errors import BadInput

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
