"""The verb `labanmesh completion`: the script that `make surface` makes from the registry of verbs."""

from importlib.resources import files
from typing import Annotated

import typer

from common.errors import BadInput

FOR_ZSH = "autoload -U +X bashcompinit && bashcompinit\n"
"""zsh then understands bash's completions."""


def completion(shell: Annotated[str, typer.Argument(help="bash or zsh.")] = "bash") -> None:
    """Print a script by which Tab completes verbs and options; scene files and others complete as usual.

    Example: labanmesh completion bash >> ~/.bashrc
    """
    if shell not in ("bash", "zsh"):
        raise BadInput(f"{shell!r}: bash or zsh is expected")
    script = (files("deploy.completion") / "labanmesh.bash").read_text(encoding="utf-8")
    typer.echo((FOR_ZSH if shell == "zsh" else "") + script, nl=False)
