"""Calling a command of Typer: its errors become one line of ours, a closed pipe and Ctrl-C stay what they are."""

import shlex
from collections.abc import Callable, Sequence
from typing import Any

import typer
from typer.exceptions import TyperException

from common.errors import BadInput


def call_command(
    app: typer.Typer,
    words: Sequence[str],
    program: str,
    name: str = "",
    about: Callable[[str], str] = lambda option: "",
) -> int:
    """Parse `words` and call the command; returns its status, 0 for a command that gives none.

    program: what was typed before `words`; name: its last word, which begins an error. about: what is to be said of an
    option that the command does not have, "" for nothing. Raises BadInput for words that the command does not take,
    KeyboardInterrupt for Typer's own abort, BrokenPipeError where nobody reads the output.
    """
    try:
        status = typer.main.get_command(app).main(list(words), program, standalone_mode=False)
    except TyperException as error:
        text = " ".join(error.format_message().split()) if hasattr(error, "format_message") else str(error)
        text = about(getattr(error, "option_name", "")) or text
        # Typer names the parameter and the rule; the value is in what was typed.
        typed = shlex.join([name, *words]) if isinstance(error, typer.BadParameter) else name
        context = getattr(error, "ctx", None)
        example = _example(context, program) if text.startswith("Missing ") else ""
        path = getattr(context, "command_path", program)
        raise BadInput(f"{f'{typed}: ' if name else ''}{text.rstrip('.')}{example}; see {path} --help") from None
    except SystemExit as ending:  # typer makes a status of 1 of a closed pipe
        raise ending.__context__ if isinstance(ending.__context__, BrokenPipeError) else ending from None
    except typer.Abort:
        raise KeyboardInterrupt from None
    return status if isinstance(status, int) else 0


def _example(context: Any, program: str) -> str:  # noqa: ANN401 - the class of Typer is private
    """The first example in the help of what was called, a verb or a sub-verb, as the middle of a line; "" without."""
    text = getattr(getattr(context, "command", None), "help", None) or ""
    examples = text.partition("Example: ")[2].splitlines()
    return f", e.g. {examples[0]}" if examples and examples[0].startswith(f"{program} ") else ""
