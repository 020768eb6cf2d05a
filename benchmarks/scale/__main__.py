"""`python -m benchmarks.scale`: what it costs to grow, from the measured costs and your assumptions."""

import sys
from dataclasses import fields, replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.command_line import read_page, replace_table, run_command
from benchmarks.scale.homes import Assumptions
from benchmarks.scale.measured import Measured, parse_measured
from benchmarks.scale.process import Load
from benchmarks.scale.table import FACTORS, ScaleInputs, marks, tables
from common.errors import BadInput, reason_of
from studies.output_files import write_text

MEASURED = "measured.json"


def scale(
    homes: Annotated[str, typer.Option(help="Numbers of homes separated by commas; default: 1 to 1,000,000.")] = "",
    rate: Annotated[float, typer.Option(min=0.1, help="Posteriors per second of each observer in a home.")] = 30.0,
    step_hz: Annotated[float, typer.Option(min=0.1, help="Judgements per second of each scene.")] = 10.0,
    assume: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=NUMBER", help="Another price or habit, e.g. core_hour=0.03; may be repeated."),
    ] = None,
    measured: Annotated[
        Path | None, typer.Option(help="A file that python -m benchmarks.scale.measure --write has written.")
    ] = None,
    page: Annotated[Path | None, typer.Option(help="A markdown page whose tables are replaced.")] = None,
) -> None:
    """Simulate fusion processes from measured costs; homes by factors of ten: processes, cores, bytes, money.

    Example: python -m benchmarks.scale

    Example: python -m benchmarks.scale --homes 40,400 --assume core_hour=0.03 --assume support_min=5
    """
    assumed = replace(Assumptions(), **dict(_assumption(text) for text in assume or ()))
    load = Load(rate_hz=rate, step_hz=step_hz)
    made = tables(ScaleInputs(_measured(measured), assumed, load, _counts(homes) or FACTORS))
    if page:
        write_tables(page, made)
    else:
        print("\n\n".join(made.values()))


def _measured(path: Path | None) -> Measured:
    place = path or files("benchmarks.scale") / MEASURED
    try:
        return parse_measured(place.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"cannot read {place}: {reason_of(error)}. Choose another file") from None
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(
            f"{place}: not a file of measurements ({type(error).__name__}: {error}); "
            "python -m benchmarks.scale.measure --write FILE writes one"
        ) from None


def _counts(text: str) -> tuple[int, ...]:
    try:
        counts = tuple(int(part) for part in text.split(",") if part.strip())
    except ValueError:
        counts = (0,)
    if any(count < 1 for count in counts):
        raise BadInput(f"--homes {text!r}: expected whole numbers above 0 separated by commas, as 1,10,100")
    return counts


def _assumption(text: str) -> tuple[str, float]:
    name, _, number = text.partition("=")
    known = [field.name for field in fields(Assumptions)]
    try:
        value = float(number)
    except ValueError:
        value = -1.0
    if name not in known or not 0 <= value < float("inf"):
        raise BadInput(f"--assume {text!r}: expected NAME=NUMBER, not below 0; names: {', '.join(known)}")
    if name == "cell" and value < 1:
        raise BadInput(f"--assume {text!r}: a cell has at least 1 home")
    return name, value


def write_tables(page: Path, made: dict[str, str]) -> None:
    """Replace the tables of a page; raises BadInput, and leaves the page unchanged, when one has no place there."""
    text = read_page(page, *marks(next(iter(made))))
    for name, table in made.items():
        text = replace_table(text, table, *marks(name))
    write_text(page, text, "--page")


if __name__ == "__main__":
    sys.exit(run_command(scale, "scale"))
