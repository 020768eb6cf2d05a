"""The verb `labanmesh fuse`: the referee of a scene at the command line."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from common.config import read_scene
from common.errors import BadInput
from common.keys import identifier
from common.lifecycle import log_to_stderr, stop_on_signals
from common.link import Link, MeshRole
from fusion.engine.rules import get_rule
from fusion.memory_file import Memory
from fusion.service import known_vocabulary, serve


def fuse(
    scenes: Annotated[
        list[Path],
        typer.Argument(help="The scene file (TOML), the same for every process of the scene; or several, or a folder."),
    ],
    service: Annotated[str, typer.Option("--id", metavar="ID", help="Which of the fusion services this one is.")] = "",
) -> None:
    """The referee: weighs the observers of a scene by how certain they are, publishes judgements and verdicts.

    Observers may come and go, before or after it. Where the scene names further services ([fusion] standby), one leads
    and the others stand by. SIGTERM or Ctrl-C ends it.

    Of many scenes, each process with an --id of its own judges a share, and who comes or goes moves only its own share.

    Example: labanmesh fuse scene.toml

    Example: labanmesh fuse scene.toml --id second

    Example: labanmesh fuse scenes/ --id north

    Example: LABANMESH_FUSION_RULE=log labanmesh fuse scene.toml
    """
    log_to_stderr()
    files = list(scene_files(scenes))
    if len(files) > 1:
        _judge_many(files, service)
    else:
        _judge_one(files[0], service)


def scene_files(named: Sequence[Path]) -> Iterator[Path]:
    """The files themselves, and of a folder all *.toml; raises BadInput for a folder without any."""
    for path in named:
        if not path.is_dir():
            yield path
            continue
        inside = sorted(path.glob("*.toml"))
        if not inside:
            raise BadInput(f"{path}: no scene file in this folder; scene files end in .toml")
        yield from inside


def _judge_one(path: Path, service: str) -> None:
    from fusion.engine.engine import FusionEngine

    whole = read_scene(path)
    named = whole.for_service(service or whole.fusion.id)
    get_rule(named.fusion.rule, len(named.roster))
    # On one machine the first service is where all meet; the others come there as observers do.
    role: MeshRole = "fusion" if named.fusion.id == whole.fusion.id else "standby"
    memory = Memory(named.place(named.fusion.memory)) if named.fusion.memory else None
    with stop_on_signals() as stop, Link.open(named.mesh, role, process_id=named.fusion.id) as link:
        vocabulary = known_vocabulary(named, link, stop)
        if vocabulary is not None:
            referee = FusionEngine(named.scene, list(named.roster), vocabulary, named.fusion)
            serve(named, referee, link, stop, memory=memory)


def _judge_many(files: Sequence[Path], service: str) -> None:
    from fusion.fleet import require_shareable, serve_many

    read = [read_scene(path) for path in files]
    require_shareable(read)
    first = read[0].fusion.id
    own = identifier(service or first, "--id")
    scenes = [scene.for_shared_service(own) for scene in read]
    role: MeshRole = "fusion" if own == first else "standby"
    with stop_on_signals() as stop, Link.open(scenes[0].mesh, role, process_id=own) as link:
        serve_many(scenes, link, stop)
