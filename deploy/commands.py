"""The verbs `labanmesh up` and `labanmesh router`: a whole scene on one machine, and where machines meet."""

import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from common.address import Address
from common.config import MeshConfig, Scene, read_scene
from common.errors import BadInput, LabanmeshError
from common.lifecycle import log_to_stderr, stop_on_signals
from deploy.launcher import Job, Launcher
from deploy.supervision import Patience

START_TOGETHER_S = 2.0
"""Recordings begin this long after the launcher, when all observers are up: so that they see the same at once."""
EACH_OBSERVER_S = 0.2
HUBS = {"mqtt": ("hub", "mqtt"), "dashboard": ("dashboard",)}
FAILURES_WHEN_IT_SHALL_END = 5
"""A scene that shall end by itself does not try a failing observer for ever."""


def up(
    scene: Annotated[Path, typer.Argument(help="The scene file (TOML).")],
    for_s: Annotated[
        float | None, typer.Option("--for", metavar="SECONDS", min=0, help="End by itself after so long.")
    ] = None,
    exit_when_done: Annotated[
        bool, typer.Option("--exit-when-done", help="End when all recordings have been played.")
    ] = False,
) -> int:
    """All processes that a scene file names, on this machine: the referee and each observer, supervised.

    Who fails is started again, ever later; one log on stderr names who says what. SIGTERM or Ctrl-C ends all.

    Example: labanmesh up scene.toml

    Example: labanmesh up scene.toml --exit-when-done
    """
    named = read_scene(scene)
    if named.mesh.mode == "process":
        raise BadInput(f"{scene}: mesh.mode = 'process': several processes cannot meet so; choose machine or router")
    for name in _fed_by_hand(named):
        own = f"TRACKER | labanmesh observe {scene} {name}"
        print(f"{name}: reads tracks from its standard input, start it by hand: {own}", file=sys.stderr)
    start_ns = time.time_ns() + round((START_TOGETHER_S + EACH_OBSERVER_S * len(named.roster)) * 1e9)
    with stop_on_signals() as stop, tempfile.TemporaryDirectory(prefix="labanmesh-") as kept:
        launcher = Launcher(
            with_ports(jobs(scene, named), named.metrics.listen),
            environment={"LABANMESH_PLAYBACK_START_NS": str(start_ns), **_memory(named, Path(kept))},
            patience=Patience(failures=FAILURES_WHEN_IT_SHALL_END if exit_when_done else None),
        )
        timer = threading.Timer(for_s or 0, stop.set)
        timer.daemon = True
        if for_s is not None:
            timer.start()
        status = launcher.run(stop, exit_when_done=exit_when_done, linger_s=named.fusion.drop_s)
        timer.cancel()
    if status:
        raise LabanmeshError(f"{scene}: not all processes could do their work; the log above says why")
    return 0


def _memory(scene: Scene, folder: Path) -> dict[str, str]:
    """A lone referee that is started again goes on with its movement; of several, another one does."""
    if scene.fusion.memory or scene.fusion.standby:
        return {}
    return {"LABANMESH_FUSION_MEMORY": str(folder / "movement.json")}


def jobs(path: Path, scene: Scene) -> list[Job]:
    """The processes of a scene: its fusion services, each observer that needs nobody at its standard input, its hubs.

    A router, if the mesh has one, is run apart.
    """
    python = [sys.executable, "-P", "-m", "labanmesh"]
    others = scene.fusion.standby
    fuse = [Job("[fuse]", [*python, "fuse", str(path)], lasting=True)]
    fuse += [Job(f"[fuse {name}]", [*python, "fuse", str(path), "--id", name], lasting=True) for name in others]
    started = [name for name in scene.roster if name not in _fed_by_hand(scene)]
    observe = [Job(name, [*python, "observe", str(path), name]) for name in started]
    hubs = [Job(f"[{name}]", [*python, *HUBS[name], str(path)], lasting=True) for name in scene.hub.start]
    return [*fuse, *observe, *hubs]


def with_ports(jobs: Sequence[Job], listen: str) -> list[Job]:
    """The same jobs, each with a port of its own for /metrics: the first has that of `listen`, "": none has any."""
    if not listen:
        return list(jobs)
    first = Address.parse(listen, "metrics.listen")
    ports = {job.name: {"LABANMESH_METRICS_LISTEN": str(first.after(n))} for n, job in enumerate(jobs)}
    return [replace(job, environment={**job.environment, **ports[job.name]}) for job in jobs]


def _fed_by_hand(scene: Scene) -> list[str]:
    return [name for name in scene.roster if scene.observer(name).source == "-"]


def router(
    endpoint: Annotated[
        str, typer.Argument(help="Where it listens: tcp/0.0.0.0:7447 is every interface of this machine.")
    ] = "",
    scene: Annotated[
        list[Path] | None,
        typer.Option(help="The scene file, or a folder of them; repeatable. A secured router admits their machines."),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="A whole Zenoh configuration (JSON5), as `labanmesh secure rules` prints it.")
    ] = None,
) -> None:
    """A Zenoh router, where the machines of a mesh meet. It relays, and keeps nothing.

    Scene files then say mode = "router" and this machine's address under [mesh] endpoint. The router notices changes
    in its files.

    Example: labanmesh router tcp/0.0.0.0:7447

    Example: labanmesh router --scene scene.toml
    """
    from deploy.security.routing import plain_rules, route, rules_in_file, rules_of_scenes

    if config is not None and (scene or endpoint):
        raise BadInput(f"--config {config}: it says itself where to listen; leave out ENDPOINT and --scene")
    log_to_stderr()
    if config is not None:
        rules = rules_in_file(config)
    else:
        rules = rules_of_scenes(scene, endpoint) if scene else plain_rules(endpoint or MeshConfig().endpoint)
    with stop_on_signals() as stop:
        route(rules, stop)
