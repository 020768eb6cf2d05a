"""What the benchmarks with a command line share: options, one-line errors, recordings, tables in markdown pages."""

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path

import typer

from common.command_options import call_command
from common.errors import BadInput, LabanmeshError, reason_of
from common.interrupt import interruptible


def run_command(function: Callable[..., int | None], name: str, arguments: Sequence[str] | None = None) -> int:
    """Parse `arguments` (default: those of this process) and call `function`, whose parameters are the options.

    Returns the exit status: what `function` returns, else 0; 1 for an error at run time; 2 for bad input; 130 after
    Ctrl-C. Errors go to stderr as one line that begins with `name`.
    """
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    app.command()(function)
    words = sys.argv[1:] if arguments is None else arguments
    program = "python -m benchmarks" if name == "bench" else f"python -m benchmarks.{name}"
    try:
        # Words of a test are no command: Ctrl-C is the test runner's.
        with interruptible() if arguments is None else nullcontext():
            return call_command(app, words, program)
    except LabanmeshError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return error.exit_status
    except KeyboardInterrupt:
        return 130


def recordings_folder() -> Path:
    """The folder of recordings that LABANMESH_DATA names; raises BadInput, one line, without one."""
    place = os.environ.get("LABANMESH_DATA")
    if not place:
        raise BadInput("LABANMESH_DATA is not set: name the folder with the recordings of people")
    if not Path(place).is_dir():
        raise BadInput(f"LABANMESH_DATA = {place!r}: no such folder; name the folder with the recordings of people")
    return Path(place)


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """A table whose first `left` columns are aligned to the left, the others to the right."""
    rule = ["---"] * left + ["---:"] * (len(head) - left)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows))


def replace_table(page: str, table: str, begin: str, end: str) -> str:
    """The page with `table` between its two marks; raises BadInput when a mark is missing."""
    before, begin_mark, rest = page.partition(begin)
    _, end_mark, after = rest.partition(end)
    if not (begin_mark and end_mark):
        raise BadInput(f"the page has no place for the table: it needs the lines {begin} and {end}")
    return f"{before}{begin}\n{table}\n{end}{after}"


def read_page(page: Path | None, begin: str, end: str) -> str:
    """The text of a page, checked before the long work; "" for None. Raises BadInput for one without the marks."""
    if page is None:
        return ""
    try:
        text = page.read_text(encoding="utf-8")
    except OSError as error:
        raise BadInput(f"cannot read {page}: {reason_of(error)}. Choose another page with --page") from None
    try:
        replace_table(text, "", begin, end)
    except BadInput as error:
        raise BadInput(f"--page {page}: {error}") from None
    return text
