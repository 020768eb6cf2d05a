"""The verb `labanmesh doctor`: runs all checks at once, and reports each fault with its remedy."""

import os
import re
import shlex
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from common.config import Scene, read_scene
from common.errors import BadInput
from common.text import split_list
from deploy.doctor.broker import broker_facts, check_broker
from deploy.doctor.cameras import TEST_S, check_cameras, observer_cameras, webcams
from deploy.doctor.findings import EffectiveSetting, Finding, Group, Mark, as_json, of_group, page, warning, worst
from deploy.doctor.machine import MachineNeeds, check_machine, installed_version, machine_facts, machine_needs
from deploy.doctor.mesh import ExpectedMesh, MeshFacts, check_mesh, listen, no_process
from deploy.doctor.network import check_network, is_free, network_facts
from deploy.doctor.scene_file import check_refused, check_scene, scene_facts, scenes_in
from deploy.doctor.security import check_security, security_facts

MACHINE_S, SCENE_S, NETWORK_S = 5.0, 31.0, 6.0
"""How long checks may take, also on a busy machine; that of the network on top of the time that it listens."""
NO_OBSERVER = "none"
NO_WEBCAM = warning("no webcam on this machine", "plug one in, or name an address or a recording as source")
MARK_COLOURS: dict[Mark, str] = {"ok": "green", "hint": "cyan", "warning": "yellow", "error": "red"}


def doctor(
    scene: Annotated[
        Path | None, typer.Argument(help="The scene file; without it the doctor checks this machine alone.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="The findings as JSON.")] = False,
    for_s: Annotated[
        float, typer.Option("--for", metavar="SECONDS", min=0.5, max=3600, help="How long to listen to the mesh.")
    ] = 2.0,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="Also the settings in force, and where each came from.")
    ] = False,
    test_cameras: Annotated[bool, typer.Option("--cameras", help="Also open the cameras: up to 20 s.")] = False,
    observers: Annotated[
        str, typer.Option(metavar="IDS", help="Which observers run on this machine; none: no one. Default: all.")
    ] = "",
    # The command line runs deploy.doctor.ready with it (labanmesh.py:OTHER_FORMS); here it is for --help.
    ready: Annotated[
        bool, typer.Option("--ready", help="Only whether all processes, or one, do their work: doctor --ready --help.")
    ] = False,
) -> int:
    """What is wrong with this machine, the scene file, cameras, network, security and mesh, and what to do.

    Exit status: 0 all well or warnings only, 1 there are errors, 2 the command line is wrong.

    Example: labanmesh doctor scene.toml

    Example: labanmesh doctor scene.toml --json | jq '.findings[] | select(.mark == "error")'
    """
    here = None if not observers else () if observers == NO_OBSERVER else split_list("--observers", observers)
    settings: list[EffectiveSetting] = []
    if scene is None:
        webcam_check = Check("cameras", MACHINE_S, lambda: check_cameras([], webcams(), certain=True) or [NO_WEBCAM])
        scene_check = Check("the scene file", SCENE_S, lambda: list(scenes_in(Path())))
        findings = run_checks([_machine_check(None, ()), scene_check, webcam_check])
    else:
        findings = _with_scene(scene, here, for_s, settings, test_cameras=test_cameras)
    name = shlex.quote(str(scene)) if scene else "SCENE"
    # The commands name the file, so that they can be copied.
    findings = [replace(each, to_do=re.sub(r"\bSCENE\b", lambda _: name, each.to_do)) for each in findings]
    shown = settings if verbose else ()
    if json:
        typer.echo(as_json(findings, installed_version("labanmesh"), shown))
    else:
        _print_page(findings, shown)
    return int(worst(findings) == "error")


@dataclass(frozen=True, slots=True)
class Check:
    """One check. group: the heading of its findings that have none."""

    group: Group
    limit_s: float
    run: Callable[[], Sequence[Finding]]


def run_checks(checks: Sequence[Check]) -> list[Finding]:
    """The findings of all checks, in their order. They run at once, each in a thread.

    A check that fails or exceeds its limit_s becomes a finding, so the doctor always answers.
    """
    of_checks: dict[int, Sequence[Finding]] = {}

    def run(number: int, check: Check) -> None:
        try:
            of_checks[number] = check.run()
        except Exception as error:  # noqa: BLE001 - whatever it is, the other checks have findings
            what = f"the check failed: {type(error).__name__}: {error}"
            of_checks[number] = [warning(what, "this is a bug in labanmesh: please report it")]

    began_s, findings = time.monotonic(), list[Finding]()
    # A daemon thread that hangs does not keep the process alive.
    threads = [threading.Thread(target=run, args=each, daemon=True) for each in enumerate(checks)]
    for thread in threads:
        thread.start()
    for number, (check, thread) in enumerate(zip(checks, threads, strict=True)):
        thread.join(max(0.0, began_s + check.limit_s - time.monotonic()))
        late = warning(f"the check took longer than {check.limit_s:g} s", "try again; is this machine very busy?")
        findings += of_group(check.group, of_checks.get(number, [late]))
    return findings


def _with_scene(
    path: Path, here: Sequence[str] | None, for_s: float, settings: list[EffectiveSetting], *, test_cameras: bool
) -> list[Finding]:
    if not path.exists():
        raise BadInput(f"{path}: no such file; name a scene file, or make one: labanmesh init {path}")
    try:
        scene = read_scene(path)
    except BadInput as fault:
        refused = fault
        return run_checks([
            _machine_check(None, ()),
            Check("the scene file", SCENE_S, lambda: check_refused(path, refused, here)),
        ])  # fmt: skip
    observers = scene.roster if here is None else here
    for name in observers:
        scene.observer(name)
    certain = here is not None or scene.mesh.mode != "router"

    def scene_findings() -> list[Finding]:
        facts = scene_facts(path, scene, here)
        settings.extend(facts.settings)
        return check_scene(facts)

    def camera_findings() -> list[Finding]:
        return check_cameras(observer_cameras(scene, observers, test=test_cameras), webcams(), certain=certain)

    return run_checks([
        _machine_check(scene, observers, certain=certain),
        Check("the scene file", SCENE_S, scene_findings),
        Check("cameras", MACHINE_S + (TEST_S if test_cameras else 0), camera_findings),
        Check("network", NETWORK_S + for_s, lambda: list(_mesh_findings(path, scene, for_s))),
        Check("Home Assistant", MACHINE_S, lambda: list(check_broker(broker_facts(scene)))),
    ])  # fmt: skip


def _machine_check(scene: Scene | None, observers: Sequence[str], *, certain: bool = True) -> Check:
    def run() -> list[Finding]:
        needs = machine_needs(scene, observers) if scene else MachineNeeds()
        return check_machine(machine_facts(Path()), needs, certain=certain)

    return Check("this machine", MACHINE_S, run)


def _mesh_findings(path: Path, scene: Scene, for_s: float) -> Iterator[Finding]:
    """Network, security and mesh one after the other: each needs the facts of the one before."""
    if scene.mesh.mode == "process":
        return
    facts = listen(scene, network_facts(scene.mesh), for_s)
    yield from check_network(facts.network)
    yield from of_group("security", check_security(security_facts(facts.network), datetime.now(UTC)))
    yield from of_group("the mesh", _heard(path, scene, facts))


def _heard(path: Path, scene: Scene, facts: MeshFacts) -> list[Finding]:
    expected = ExpectedMesh(scene, installed_version("labanmesh"), str(path), facts.partly)
    if facts.traffic is not None:
        return check_mesh(expected, facts.traffic)
    if is_free(facts.network):
        return [no_process(expected)]
    what = f"not listened to, at {facts.network.mesh.endpoint}"
    return [warning(what, "correct the findings on network and security first")]


def _print_page(findings: Sequence[Finding], settings: Sequence[EffectiveSetting]) -> None:
    coloured = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    for line, mark in page(findings, settings):
        styled = coloured and (mark is not None or not line.startswith(" "))
        typer.echo(typer.style(line, fg=MARK_COLOURS[mark] if mark else None, bold=mark is None) if styled else line)
