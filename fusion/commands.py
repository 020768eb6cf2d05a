"""The verb `labanmesh fuse`: a fusion service of one or many scenes."""

import gc
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from common.config import Scene, read_scene, scene_files
from common.errors import BadInput
from common.keys import identifier
from common.lifecycle import log_to_stderr, stop_on_signals
from common.link import Link, MeshRole
from common.message_checks import require_fits
from fusion.same_id import IdCheck


def fuse(
    scenes: Annotated[
        list[Path],
        typer.Argument(help="The scene file (TOML), the same for every process of the scene; or several, or a folder."),
    ],
    service: Annotated[str, typer.Option("--id", metavar="ID", help="The id of this fusion service.")] = "",
) -> None:
    """Weigh the observers of a scene by their certainty; publish judgements and verdicts.

    Observers may come and go, before or after this service starts. If the scene names further services ([fusion]
    standby), one of them publishes and the others stand by. SIGTERM or Ctrl-C ends the service.

    Several processes, each with its own --id, share the scenes of a folder: each scene is published by one of them. A
    process that starts or stops moves only its own share.

    Example: labanmesh fuse scene.toml

    Example: labanmesh fuse scene.toml --id second

    Example: labanmesh fuse scenes/ --id north

    Example: LABANMESH_FUSION_RULE=log labanmesh fuse scene.toml
    """
    log_to_stderr()
    configs = [read_scene(path) for path in scene_files(scenes)]
    first = configs[0].fusion.id
    own = identifier(service or first, "--id")
    shared = len(configs) > 1
    # On one machine the others connect to the first service, as observers do.
    role: MeshRole = "fusion" if own == first else "standby"
    require_servable(configs, own, role, shared=shared)
    with stop_on_signals() as stop, Link.open(configs[0].mesh, role, process_id=own, stop=stop) as link:
        id_check = IdCheck(configs, own, link)
        # The engine is loaded while other processes become known.
        from fusion.server import serve

        # A collection that looked through all loaded modules would delay a judgement by 30 ms.
        gc.freeze()
        serve(configs, own, link, stop, shared=shared, id_check=id_check)


def require_servable(scenes: Sequence[Scene], own: str, role: MeshRole, *, shared: bool) -> None:
    """Raises BadInput, one line, if the service `own` of this machine cannot serve these scenes together."""
    from fusion.engine.rules import get_rule

    require_compatible(scenes)
    for scene in scenes:
        get_rule(scene.fusion.rule)
        require_fits(scene)
        scene.require_service(own, shared=shared)
    for scene in scenes:
        require_certificate(scene, role, own)


def require_compatible(scenes: Sequence[Scene]) -> None:
    """Raises BadInput, one line, for scenes that one process cannot serve together."""
    first, names, files = scenes[0], set[str](), dict[str, str]()
    for scene in scenes:
        if scene.scene in names:
            raise BadInput(f"scene {scene.scene!r}: in two of the files; each scene is fused once")
        names.add(scene.scene)
        if scene.mesh != first.mesh:
            raise BadInput(f"scene {scene.scene!r}: another [mesh] than {first.scene!r}; one process has one link")
        if scene.fusion.memory and not scene.place(scene.fusion.memory).is_dir():
            path = str(scene.place(scene.fusion.memory).absolute())
            if path in files:
                raise BadInput(
                    f"scene {scene.scene!r}: fusion.memory = {scene.fusion.memory!r} is the file of {files[path]!r} "
                    "too; each scene needs a file of its own"
                )
            files[path] = scene.scene


def require_certificate(scene: Scene, role: MeshRole, own: str) -> None:
    """Raises BadInput when this machine's certificate is not for the fusion service `own` of the scene."""
    if scene.mesh.credentials:
        # Cryptography is loaded only where there are certificates.
        from common.credentials import require_credentials

        require_credentials(Path(scene.mesh.credentials), role, own, datetime.now(UTC), scene.scene)
