"""The verb `labanmesh hub` with its sub-verbs: what a home gets from a scene."""

from pathlib import Path
from typing import Annotated

import typer

from common.config import read_scene

hub = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    no_args_is_help=False,
    help="""What homes get from a scene.

    Example: labanmesh hub mqtt scene.toml
    """,
)
# What the front door shows of a verb is its docstring.
hub.__doc__ = hub.info.help


@hub.callback()
def _sub_verbs() -> None:
    """With one sub-verb alone typer would leave its name out."""


_sub_verbs.__doc__ = hub.info.help


@hub.command()
def mqtt(
    scenes: Annotated[list[Path], typer.Argument(metavar="SCENE...", help="The scene files, as given to fuse.")],
    remove: Annotated[
        bool,
        typer.Option("--remove", help="Take the scenes out of the broker, and so out of Home Assistant; then end."),
    ] = False,
) -> None:
    """Home Assistant and others through an MQTT broker, as [hub.mqtt] of the scene file says: states and verdicts.

    Example: labanmesh hub mqtt scene.toml

    Example: labanmesh hub mqtt living-room.toml kitchen.toml

    Example: labanmesh hub mqtt scene.toml --remove
    """
    from common.lifecycle import log_to_stderr, stop_on_signals
    from hub.mqtt.removal import remove as take_out
    from hub.mqtt.service import serve

    named = [read_scene(path) for path in scenes]
    if remove:
        for scene in named:
            print(f"{scene.scene}: {take_out(scene)} retained messages taken out of the broker", flush=True)
        return
    log_to_stderr()
    with stop_on_signals() as stop:
        serve(named, stop)
