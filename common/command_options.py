"""What the command lines of several verbs share: options in one dataclass, verbs with sub-verbs, and calling Typer.

Typer's errors become one line of ours; a closed pipe and Ctrl-C stay what they are.
"""

import inspect
import shlex
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Annotated, Any, TypeVar, get_type_hints

import typer
from typer.exceptions import TyperException

from common.errors import BadInput
from common.text import with_whole_examples

LONGEST_OPTION_S = 366 * 86_400.0
"""The largest number of seconds for an option; the operating system does not wait for just any."""
ForSeconds = Annotated[
    float | None,
    typer.Option("--for", metavar="SECONDS", min=0, max=LONGEST_OPTION_S, help="End after this many seconds."),
]
Options = TypeVar("Options")
Status = TypeVar("Status")


def sub_verbs(text: str) -> typer.Typer:
    """A verb to which sub-verbs are added with `.command()`. text: its help, with an example."""
    app = typer.Typer(
        add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None, no_args_is_help=False, help=text
    )
    # With a single sub-verb Typer leaves its name out, unless there is a callback.
    app.callback()(lambda: None)
    # Tests read a verb's docstring.
    app.info.help, app.__doc__ = with_whole_examples(text), text
    return app


def takes_options(command: Callable[[Options], Status]) -> Callable[..., Status]:
    """The command with one parameter for each field of the dataclass that it takes, as Typer expects it.

    Fields are annotated as Typer's parameters: Annotated[type, typer.Option(...)].
    """
    ((_, parameter),) = inspect.signature(command).parameters.items()
    options_class: Callable[..., Options] = parameter.annotation

    @wraps(command)
    def call(**options: object) -> Status:
        return command(options_class(**options))

    call.__signature__ = inspect.signature(options_class)  # type: ignore[attr-defined]
    call.__annotations__ = get_type_hints(options_class, include_extras=True)
    return call


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
