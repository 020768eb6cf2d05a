"""Input to the scene file's models: overrides from the environment, and validation errors as one line. Pure.

An environment variable LABANMESH_<SECTION>_<KEY> overrides a key: LABANMESH_SCENE, LABANMESH_MESH_ENDPOINT,
LABANMESH_OBSERVERS_CAM1_SPEED. Lists are separated by commas; a `-` in an observer's id is a `_` in the variable.
"""

import re
from collections.abc import Iterator, Mapping
from copy import deepcopy
from fnmatch import fnmatchcase
from typing import Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from common.errors import BadInput, noting
from common.text import nearest, without_secrets

PREFIX = "LABANMESH_"
VALUE_LIMIT = 60
"""Characters of a wrong value that are quoted."""
Place = tuple[str, ...]
REMOVED_KEYS = {
    "observers.*.preview": "picture_hz on the dashboard and [observers.ID.clips] show what an observer sees",
    "observers.*.virtual*": "recorded motion is filmed in one room, with the noise of a webcam",
}
"""Keys of the last release that are gone, and what to do instead; a line stays for one release."""


def faults_of(error: ValidationError, model: type[BaseModel], *, missing: bool = True) -> list[str]:
    """One line for each fault: key, value, rule and what would be right. missing: also for keys that are missing.

    Unknown keys come first because it is often the misspelled one that is reported as missing.
    """
    faults = sorted(error.errors(include_url=False), key=lambda fault: fault["type"] != "extra_forbidden")
    return [_line(fault, model) for fault in faults if missing or fault["type"] != "missing"]


def without_faults(table: Mapping[str, Any], error: ValidationError) -> dict[str, Any]:
    """A copy of `table` whose other keys can be checked: faulty ones are left out, and a required one is "x"."""
    copy: dict[Any, Any] = deepcopy(dict(table))
    for fault in error.errors():
        section: dict[int | str, Any]
        # What is wrong with a section as a whole begins with the key at fault.
        of_section = [_rule(fault["msg"]).partition(" ")[0]] if _is_of_section(fault) else []
        section, deeper = copy, [*fault["loc"], *of_section]
        while len(deeper) > 1 and isinstance(section.get(deeper[0]), dict):
            section = section[deeper.pop(0)]
        section.pop(deeper[0], None)
        if fault["type"] == "missing":
            section[deeper[0]] = "x"
    return copy


def without_removed(table: Mapping[str, Any], error: ValidationError) -> dict[str, Any] | None:
    """`table`, as an earlier version wrote it, without the keys that are gone since; None if anything else is wrong."""
    faults = error.errors()
    gone = all(f["type"] == "extra_forbidden" and _removed(".".join(map(str, f["loc"]))) for f in faults)
    return without_faults(table, error) if gone else None


def override(table: dict[str, Any], model: type[BaseModel], environment: Mapping[str, str]) -> list[str]:
    """Write the overrides in `environment` into `table`, the scene file as parsed; returns the faults, a line each.

    A value of the wrong type is one, and a variable that starts like a section but names no key.
    """
    faults: list[str] = []
    known = dict(_variables(model, table))
    sections = tuple(
        f"{PREFIX}{name.upper()}_" for name, field in model.model_fields.items() if _section(field.annotation)
    )
    for variable in sorted(environment):
        if variable in known:
            place, field = known[variable]
            with noting(faults):
                _write(table, place, _value(variable, environment[variable], field))
        elif variable.startswith(sections):
            removed = _removed(variable.removeprefix(PREFIX).lower())
            rule = f"its key was removed, unset it; {removed}" if removed else ""
            faults.append(f"{variable}: {rule or f'unknown environment variable; {nearest(variable, known)}'}")
    return faults


def _is_of_section(fault: Mapping[str, Any]) -> bool:
    """Whether keys of one section do not fit each other; the rule begins with the key at fault."""
    return fault["type"] == "value_error" and isinstance(fault["input"], dict)


def _line(fault: Mapping[str, Any], model: type[BaseModel]) -> str:
    place, kind, value = tuple(map(str, fault["loc"])), fault["type"], fault.get("input")
    key = ".".join(place)
    if kind == "extra_forbidden":
        if removed := _removed(key):
            return f"{key}: this key was removed, delete it; {removed}"
        known = _at(place[:-1], model)[1].model_fields
        home = next((name for name in _sections_with(place[-1], model) if name != ".".join(place[:-1])), "")
        return f"{key}: unknown key; {f'it belongs below [{home}]' if home else nearest(place[-1], known)}"
    named = tuple(part for part in place if not part.isdecimal()) or place
    field, _ = _at(named, model)
    if kind == "missing":
        of_list = named != place
        rule = f"item {int(place[-1]) + 1} is missing" if of_list else "missing; this key has no default"
        return f"{'.'.join(named)}: {rule}{_example(named[-1], field)}"
    if _is_of_section(fault):
        return f"{key}.{_rule(fault['msg'])}"
    section = key if place[0] != "observers" or len(place) > 2 else "observers.ID], e.g. [observers.cam1"
    rule = _rule(fault["msg"]).replace("[section]", f"[{section}]")
    way_out = _way_out(kind, value, named[-1], field) if named == place else _example(named[-1], field)
    return f"{key} = {_quoted(value)}: {rule}{way_out}"


def _removed(key: str) -> str:
    """What to do instead of a removed key, or of its variable; "" for any other."""
    plain = key.replace("_", ".")
    return next((own for removed, own in REMOVED_KEYS.items() if fnmatchcase(plain, removed.replace("_", "."))), "")


def _rule(message: str) -> str:
    """A message of pydantic in the words of the scene file."""
    rule = message.removeprefix("Value error, ").replace("Input should be", "must be").replace("valid tuple", "list")
    rule = re.sub(r"(String|Tuple) should have", "must have", rule).replace(" after validation", "")
    rule = re.sub(r"a valid dictionary( or instance of \w+)?", "a table, which starts with [section]", rule)
    return rule.replace("a valid string", "text in quotes").replace("a valid boolean", "true or false")


def _way_out(kind: str, value: object, name: str, field: FieldInfo | None) -> str:
    """What would be right, for faults whose rule does not say it; it begins with a semicolon."""
    is_text = isinstance(value, str)
    if kind == "bool_type":
        yes = is_text and str(value).lower() in ("true", "yes", "on", "1")
        return f"; write {name} = {'true' if yes else 'false'}, without quotes" if is_text else _example(name, field)
    if kind in ("float_type", "int_type") and is_text and re.fullmatch(r"-?\d+(\.\d+)?", str(value)):
        return f"; write {name} = {value}, without quotes"
    if kind == "string_type" and isinstance(value, int | float) and not isinstance(value, bool):
        return f'; write {name} = "{value}"'
    limits = _in_schema(field, "minimum", "maximum")
    if kind in ("greater_than_equal", "less_than_equal", "finite_number") and limits:
        return f"; choose {limits['minimum']:.15g} to {limits['maximum']:.15g}"
    return "" if kind in ("value_error", "literal_error", "dict_type", "model_type") else _example(name, field)


def _example(name: str, field: FieldInfo | None) -> str:
    """`; e.g. NAME = VALUE` from the field's examples, its default or its type."""
    if field is None:
        return ""
    examples = field.examples or (_in_schema(field, "examples") or {"examples": []})["examples"]
    example = examples[0] if examples else None if field.is_required() else field.get_default()
    if example is None or isinstance(example, BaseModel):
        return ""
    example = example or (["text"] if isinstance(example, tuple) else "text" if example == "" else example)
    return f"; e.g. {name} = {_toml(example)}"


def _in_schema(field: FieldInfo | None, *keys: str) -> dict[str, Any] | None:
    """The first part of the JSON schema of `field` that has all `keys`."""
    parts: list[Any] = [field and TypeAdapter[object](field.rebuild_annotation()).json_schema()]
    while parts:
        part = parts.pop(0)
        if isinstance(part, dict):
            if all(key in part for key in keys):
                return part
            parts += part.values()
        elif isinstance(part, list):
            parts += part
    return None


def _quoted(value: object) -> str:
    """A wrong value as the file has it, shortened."""
    quoted = repr(without_secrets(value)) if isinstance(value, str) else _toml(value)
    return quoted if len(quoted) <= VALUE_LIMIT else f"{quoted[:VALUE_LIMIT]}..."


def _toml(value: object) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} = {_toml(inner)}' for key, inner in value.items())}}}"
    return str(value)


def _sections_with(key: str, model: type[BaseModel], place: Place = ()) -> Iterator[str]:
    """The sections that have a key of this name, in the words of the reference: `observers.ID`."""
    for name, field in model.model_fields.items():
        section = _section(field.annotation)
        if section is not None:
            here = (*place, name) if isinstance(field.annotation, type) else (*place, name, "ID")
            if key in section.model_fields:
                yield ".".join(here)
            yield from _sections_with(key, section, here)


def _at(place: Place, model: type[BaseModel]) -> tuple[FieldInfo | None, type[BaseModel]]:
    """The field of the key at `place`, in which the names of a table of sections are skipped, and its section."""
    field = None
    for part in place:
        field = model.model_fields.get(part)
        model = (_section(field.annotation) if field else None) or model
    return field, model


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
        fault = error.errors()[0]
        example = _example("", field).replace("e.g.  = ", "e.g. ") if fault["type"].endswith("_parsing") else ""
        raise BadInput(f"{variable} = {text!r}: {_rule(fault['msg'])}{example}") from None


def _write(table: dict[str, Any], place: Place, value: object) -> None:
    for part in place[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            return  # the file has a value where a section belongs: validation reports it
    table[place[-1]] = value
