"""What a person types after an option: lists by commas, one of several names."""

from collections.abc import Sequence

from common.errors import BadInput


def words(option: str, text: str) -> tuple[str, ...]:
    """`a, b` -> (`a`, `b`), and nothing for an empty text; raises BadInput for an empty piece between commas."""
    pieces = tuple(piece.strip() for piece in text.split(",")) if text else ()
    if not all(pieces):
        raise BadInput(f"{option} {text!r}: a name is missing between commas")
    return pieces


def numbers(option: str, texts: Sequence[str]) -> dict[str, float]:
    """`NAME=NUMBER` each -> {name: number}; raises BadInput for anything else."""
    given = {}
    for text in texts:
        name, equals, number = text.partition("=")
        try:
            given[name.strip()] = float(number)
        except ValueError:
            equals = ""
        if not equals or not name.strip():
            raise BadInput(f"{option} {text!r}: NAME=NUMBER is expected")
    return given


def one_of(option: str, value: str, known: Sequence[str]) -> str:
    """`value`; raises BadInput that lists the known ones when it is none of them."""
    if value not in known:
        raise BadInput(f"{option} {value!r}: unknown; known: {', '.join(known)}")
    return value
