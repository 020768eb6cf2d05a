"""What the command lines of several verbs share: options in one dataclass, and verbs with sub-verbs."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Annotated, TypeVar, get_type_hints

import typer

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
