"""Text that people type and read: values of command-line options, plural forms, suggestions. Pure."""

from collections.abc import Iterable, Sequence

from common.errors import BadInput


def plural(count: int, singular: str, irregular: str = "") -> str:
    """The count with its noun: `1 recording`, `2 recordings`; `irregular` is a plural that does not end in s."""
    return f"{count} {singular if count == 1 else irregular or singular + 's'}"


def nearest(word: str, known: Iterable[str]) -> str:
    """A suggestion for an unknown word: the nearest known one, or all of them if none is near."""
    from difflib import get_close_matches

    names = list(known)
    near = get_close_matches(word, names, 1)
    return f"did you mean {near[0]}?" if near else f"known: {', '.join(names)}"


def split_list(option: str, text: str) -> tuple[str, ...]:
    """The parts of a list separated by commas: `a, b` -> (`a`, `b`); empty text has no parts.

    Raises BadInput for an empty part.
    """
    parts = tuple(part.strip() for part in text.split(",")) if text else ()
    if not all(parts):
        raise BadInput(f"{option} {text!r}: a name is missing between commas; write NAME,NAME")
    return parts


def named_numbers(option: str, texts: Sequence[str]) -> dict[str, float]:
    """Each `NAME=NUMBER` as an entry of a dictionary; raises BadInput for any other text."""
    numbers = {}
    for text in texts:
        name, equals, number = text.partition("=")
        try:
            numbers[name.strip()] = float(number)
        except ValueError:
            equals = ""
        if not equals or not name.strip():
            raise BadInput(f"{option} {text!r}: NAME=NUMBER is expected")
    return numbers


def one_of(option: str, value: str, known: Sequence[str]) -> str:
    """`value` if it is in `known`; raises BadInput that lists the known values otherwise."""
    if value not in known:
        raise BadInput(f"{option} {value!r}: unknown; known: {', '.join(known)}")
    return value
