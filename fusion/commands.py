"""The verb `labanmesh fuse`: the referee of a scene at the command line."""

from pathlib import Path
from typing import Annotated

import typer

from common.config import read_scene
from common.lifecycle import log_to_stderr, stop_on_signals
from common.link import Link, Role
from fusion.memory_file import Memory
from fusion.rules import rule_named
from fusion.service import known_vocabulary, serve


def fuse(
    scene: Annotated[Path, typer.Argument(help="The scene file (TOML), the same for every process of the scene.")],
    service: Annotated[
        str, typer.Option("--id", metavar="ID", help="Which of the scene's fusion services this one is.")
    ] = "",
) -> None:
    """The referee: weighs the observers of a scene by how certain they are, publishes judgements and verdicts.

    Observers may come and go, before or after it. Where the scene names further services ([fusion] standby), one leads
    and the others stand by. SIGTERM or Ctrl-C ends it.

    Example: labanmesh fuse scene.toml

    Example: labanmesh fuse scene.toml --id second

    Example: LABANMESH_FUSION_RULE=log labanmesh fuse scene.toml
    """
    from fusion.referee import Referee

    log_to_stderr()
    whole = read_scene(scene)
    named = whole.judged_by(service or whole.fusion.id)
    rule_named(named.fusion.rule, len(named.roster))
    # On one machine the first service is where all meet; the others come there as observers do.
    role: Role = "fusion" if named.fusion.id == whole.fusion.id else "standby"
    memory = Memory(named.place(named.fusion.memory)) if named.fusion.memory else None
    with stop_on_signals() as stop, Link.open(named.mesh, role, named=named.fusion.id) as link:
        vocabulary = known_vocabulary(named, link, stop)
        if vocabulary is not None:
            referee = Referee(named.scene, list(named.roster), vocabulary, named.fusion)
            serve(named, referee, link, stop, memory=memory)
