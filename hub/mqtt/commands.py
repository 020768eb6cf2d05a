"""The verb `labanmesh hub` with its sub-verbs."""

from pathlib import Path
from typing import Annotated

import typer

from common.command_options import sub_verbs
from common.config import read_scene
from common.lifecycle import log_to_stderr, stop_on_signals
from common.link import Link
from common.text import plural
from hub.history.service import require_something, serve
from hub.notify.notifying import receivers_of

hub = sub_verbs(
    """Pass scenes on: to Home Assistant, to notifications, to a file.

    Example: labanmesh hub mqtt scene.toml

    Example: labanmesh hub events scene.toml
    """
)


@hub.command()
def mqtt(
    scenes: Annotated[list[Path], typer.Argument(metavar="SCENE...", help="The scene files, as given to fuse.")],
    remove: Annotated[
        bool, typer.Option("--remove", help="Delete the scenes from the broker, and so from Home Assistant; then end.")
    ] = False,
) -> None:
    """Publish states and verdicts to an MQTT broker, for Home Assistant and others, as [hub.mqtt] configures it.

    Example: labanmesh hub mqtt scene.toml

    Example: labanmesh hub mqtt living-room.toml kitchen.toml

    Example: labanmesh hub mqtt scene.toml --remove
    """
    from hub.mqtt.broker import remove as remove_scene
    from hub.mqtt.service import serve

    configs = [read_scene(path) for path in scenes]
    if remove:
        for scene in configs:
            number = remove_scene(scene)
            print(f"{scene.scene}: {plural(number, 'retained message')} deleted from the broker", flush=True)
        return
    log_to_stderr()
    with stop_on_signals() as stop:
        serve(configs, stop)


@hub.command()
def events(scene: Annotated[Path, typer.Argument(metavar="SCENE", help="The scene file, as given to fuse.")]) -> None:
    """Keep verdicts and falls in the file of [history], and tell the receivers of [notify.NAME].

    Example: labanmesh hub events scene.toml
    """
    config = read_scene(scene)
    require_something(config)
    receivers_of(config)
    log_to_stderr()
    with stop_on_signals() as stop, Link.open(config.mesh, "hub", scene=config.scene, stop=stop) as link:
        serve(config, link, stop)
