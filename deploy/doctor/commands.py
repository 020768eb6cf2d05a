"""The verb `labanmesh doctor`: looks at everything at once, says what is wrong and what to do."""

import os
import sys
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from common.config import Scene
from common.errors import BadInput
from common.text import split_list
from deploy.doctor import cameras, look_cameras, look_machine, look_mesh, look_scene, machine, mesh, network, scene_file
from deploy.doctor.finding import Finding, Mark, worst
from deploy.doctor.look_network import look_at_network
from deploy.doctor.look_security import look_at_security
from deploy.doctor.looking import Look, all_at_once
from deploy.doctor.origin import Setting
from deploy.doctor.report import as_json, page
from deploy.doctor.security import findings as security_findings

MACHINE_S, SCENE_S, NETWORK_S = 5.0, 11.0, 6.0
"""How long looks may take, on a machine that is busy too; that at the network on top of the time it listens."""
NOBODY = "none"
COLOURS: dict[Mark, str] = {"ok": "green", "warning": "yellow", "error": "red"}


def doctor(
    scene: Annotated[Path | None, typer.Argument(help="The scene file; without it only this machine is seen.")] = None,
    json: Annotated[bool, typer.Option("--json", help="The findings as JSON.")] = False,
    for_s: Annotated[
        float, typer.Option("--for", metavar="SECONDS", min=0.5, max=3600, help="So long the mesh is listened to.")
    ] = 2.0,
    verbose: Annotated[bool, typer.Option("--verbose", help="Also what counts of the scene, and where from.")] = False,
    look: Annotated[bool, typer.Option("--cameras", help="Also open the cameras: up to 20 s.")] = False,
    observers: Annotated[
        str, typer.Option(metavar="IDS", help="Which observers run on this machine; none: no one. Default: all.")
    ] = "",
) -> int:
    """What is wrong with this machine, the scene file, cameras, network, security and mesh, and what to do.

    Exit status: 0 all well or warnings only, 1 something is wrong, 2 the command line is.

    Example: labanmesh doctor scene.toml

    Example: labanmesh doctor scene.toml --json | jq '.findings[] | select(.mark == "error")'
    """
    named = None if not observers else () if observers == NOBODY else split_list("--observers", observers)
    settings: list[Setting] = []
    if scene is None:
        findings = all_at_once([_look_at_machine(None, ()), Look("cameras", MACHINE_S, _webcams)])
    else:
        findings = _with_scene(scene, named, for_s, settings, look=look)
    shown = settings if verbose else ()
    if json:
        typer.echo(as_json(findings, look_machine.installed("labanmesh"), shown))
    else:
        _tell(findings, shown)
    return int(worst(findings) == "error")


def _with_scene(
    path: Path, named: Sequence[str] | None, for_s: float, settings: list[Setting], *, look: bool
) -> list[Finding]:
    try:
        scene = look_scene.readable_scene(path)
    except look_scene.NoScene:
        raise
    except BadInput as error:
        return [*all_at_once([_look_at_machine(None, ())]), scene_file.unreadable(str(error))]
    here = scene.roster if named is None else named
    for name in here:
        scene.observer(name)
    certain = named is not None or scene.mesh.mode != "router"

    def look_at_scene() -> list[Finding]:
        facts = look_scene.look_at_scene(path, scene, named)
        settings.extend(facts.settings)
        return scene_file.findings(facts)

    def look_at_cameras() -> list[Finding]:
        eyes = look_cameras.eyes(scene, here, look=look)
        return cameras.findings(eyes, look_cameras.webcams(), certain=certain)

    return all_at_once([
        _look_at_machine(scene, here, certain=certain),
        Look("the scene file", SCENE_S, look_at_scene),
        Look("cameras", MACHINE_S + (look_cameras.LOOK_S if look else 0), look_at_cameras),
        Look("network", NETWORK_S + for_s, lambda: list(_meet(path, scene, for_s))),
    ])  # fmt: skip


def _look_at_machine(scene: Scene | None, here: Sequence[str], *, certain: bool = True) -> Look:
    def run() -> list[Finding]:
        needs = machine.needs(scene, here) if scene else machine.Needs()
        return machine.findings(look_machine.look_at_machine(Path()), needs, certain=certain)

    return Look("this machine", MACHINE_S, run)


def _webcams() -> list[Finding]:
    return cameras.findings([], look_cameras.webcams(), certain=True) or [cameras.nothing_to_see()]


def _meet(path: Path, scene: Scene, for_s: float) -> Iterator[Finding]:
    """Network, security and mesh: one after the other, each needs what the one before saw."""
    if scene.mesh.mode == "process":
        return
    overheard = look_mesh.listen(scene, look_at_network(scene.mesh), for_s)
    yield from network.findings(overheard.network)
    yield from security_findings(look_at_security(overheard.network), datetime.now(UTC))
    expected = mesh.Expected(scene, look_machine.installed("labanmesh"), str(path), overheard.partly)
    if overheard.heard is not None:
        yield from mesh.findings(expected, overheard.heard)
    elif network.is_free(overheard.network):
        yield mesh.nobody(expected)
    else:
        yield mesh.unheard(overheard.network.mesh.endpoint)


def _tell(findings: Sequence[Finding], settings: Sequence[Setting]) -> None:
    coloured = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    for line, mark in page(findings, settings):
        styled = coloured and (mark is not None or not line.startswith(" "))
        typer.echo(typer.style(line, fg=COLOURS[mark] if mark else None, bold=mark is None) if styled else line)
