"""Runs one function as the command line of a benchmark: its parameters are the options, an error is one line."""

import sys
from collections.abc import Callable

import typer
from typer.exceptions import TyperException

from common.errors import LabanmeshError


def run_command(function: Callable[..., int | None], name: str, arguments: list[str] | None = None) -> int:
    """Parse `arguments` (default: those of this process) and call `function`.

    Returns the exit status: what `function` returns, else 0; 1 for an error at run time; 2 for bad input; 130 after
    Ctrl-C. Errors go to stderr as one line that begins with `name`.
    """
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(function)
    words = sys.argv[1:] if arguments is None else arguments
    try:
        status = typer.main.get_command(app).main(words, f"python -m benchmarks.{name}", standalone_mode=False)
    except TyperException as error:
        text = " ".join(error.format_message().split()) if hasattr(error, "format_message") else str(error)
        print(f"{name}: {text.rstrip('.')}; see python -m benchmarks.{name} --help", file=sys.stderr)
        return 2
    except LabanmeshError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return error.exit_status
    except (KeyboardInterrupt, typer.Abort):
        return 130
    return status if isinstance(status, int) else 0
