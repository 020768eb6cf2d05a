"""The verb `scale`: what it costs to grow, from what was measured here and what you assume."""

from dataclasses import fields, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.errors import BadInput

if TYPE_CHECKING:
    from benchmarks.scale.measured import Measured

MEASURED = "measured.json"


def scale(
    homes: Annotated[str, typer.Option(help="How many, by commas; by default 1 to 1,000,000.")] = "",
    rate: Annotated[float, typer.Option(min=0.1, help="Posteriors a second of each observer in a home.")] = 30.0,
    step_hz: Annotated[float, typer.Option(min=0.1, help="Judgements a second of each scene.")] = 10.0,
    assume: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=NUMBER", help="Another price or habit, e.g. core_hour=0.03; repeat."),
    ] = None,
    measured: Annotated[
        Path | None, typer.Option(help="What python -m benchmarks.scale.measure --write has written.")
    ] = None,
    page: Annotated[Path | None, typer.Option(help="A page in markdown whose tables are written anew.")] = None,
) -> None:
    """Fusion processes simulated from measured costs; homes by factors of ten: processes, cores, bytes, money.

    Example: python -m benchmarks.scale

    Example: python -m benchmarks.scale --homes 40,400 --assume core_hour=0.03 --assume support_min=5
    """
    from benchmarks.scale.homes import Assumed
    from benchmarks.scale.process import Load
    from benchmarks.scale.table import FACTORS, Question, tables

    assumed = replace(Assumed(), **dict(_assumption(text) for text in assume or ()))
    load = Load(rate_hz=rate, step_hz=step_hz)
    made = tables(Question(_measured(measured), assumed, load, _counts(homes) or FACTORS))
    if page:
        write(page, made)
    else:
        print("\n\n".join(made.values()))


def _measured(path: Path | None) -> "Measured":
    from benchmarks.scale.measured import parsed

    place = path or files("benchmarks.scale") / MEASURED
    try:
        return parsed(place.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{place}: cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(
            f"{place}: not what was measured ({type(error).__name__}: {error}); python -m benchmarks.scale.measure "
            "--write FILE writes it"
        ) from None


def _counts(text: str) -> tuple[int, ...]:
    try:
        counts = tuple(int(part) for part in text.split(",") if part.strip())
    except ValueError:
        counts = (0,)
    if any(count < 1 for count in counts):
        raise BadInput(f"--homes {text!r}: whole numbers above 0 by commas, as 1,10,100")
    return counts


def _assumption(text: str) -> tuple[str, float]:
    from benchmarks.scale.homes import Assumed

    name, _, number = text.partition("=")
    known = [field.name for field in fields(Assumed)]
    try:
        value = float(number)
    except ValueError:
        value = -1.0
    if name not in known or not 0 <= value < float("inf"):
        raise BadInput(f"--assume {text!r}: NAME=NUMBER, not below 0; names: {', '.join(known)}")
    if name == "cell" and value < 1:
        raise BadInput(f"--assume {text!r}: a cell has one home at least")
    return name, value


def write(page: Path, made: dict[str, str]) -> None:
    """The page with these tables; raises BadInput, and leaves it as it was, when one has no place there."""
    from benchmarks.scale.table import rewritten

    try:
        page.write_text(rewritten(page.read_text(encoding="utf-8"), made), encoding="utf-8")
    except KeyError as missing:
        raise BadInput(f"--page {page}: a table goes below a line that is not there: {missing.args[0]}") from None
    except OSError as error:
        raise BadInput(f"--page {page}: cannot be read and written: {error.strerror}") from None


if __name__ == "__main__":
    import sys

    from benchmarks.command_line import run_command

    sys.exit(run_command(scale, "scale"))
