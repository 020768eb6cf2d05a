"""How a fault in the scene file is told: one line with the key, the value, the rule and the nearest known key. Pure."""

import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import get_args

from pydantic import BaseModel, ValidationError

VALUE_LIMIT = 60
"""Characters of a wrong value that are quoted."""


def worded(error: ValidationError, model: type[BaseModel]) -> str:
    """The first fault as one line, and how many more there are."""
    faults = error.errors(include_url=False)
    first = faults[0]
    where = tuple(str(part) for part in first["loc"])
    line = _line(first["type"], where, first["msg"], first.get("input"), model)
    return line if len(faults) == 1 else f"{line} ({len(faults) - 1} more)"


def nearest(word: str, known: Iterable[str]) -> str:
    """The way out for a word that is not known: the nearest one that is, or all of them."""
    names = list(known)
    near = get_close_matches(word, names, 1)
    return f"did you mean {near[0]}?" if near else f"known: {', '.join(names)}"


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
