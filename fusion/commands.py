"""The verb `labanmesh fuse`: the referee of a scene at the command line."""

from pathlib import Path
from typing import Annotated

import typer

from common.config import read_scene
from common.lifecycle import log_to_stderr, stop_on_signals
from common.link import Link
from fusion.rules import rule_named
from fusion.service import known_vocabulary, serve


def fuse(
    scene: Annotated[Path, typer.Argument(help="The scene file (TOML), the same for every process of the scene.")],
) -> None:
    """The referee: weighs the observers of a scene by how certain they are, publishes judgements and verdicts.

    Observers may come and go, before or after it. SIGTERM or Ctrl-C ends it.

    Example: labanmesh fuse scene.toml

    Example: LABANMESH_FUSION_RULE=log labanmesh fuse scene.toml
    """
    from fusion.referee import Referee

    log_to_stderr()
    named = read_scene(scene)
    rule_named(named.fusion.rule, len(named.roster))
    with stop_on_signals() as stop, Link.open(named.mesh, "fusion") as link:
        vocabulary = known_vocabulary(named, link, stop)
        if vocabulary is not None:
            referee = Referee(named.scene, list(named.roster), vocabulary, named.fusion)
            serve(named, referee, link, stop)
