"""The verbs `labanmesh init` and `labanmesh up`: a scene file for this machine's cameras, and all its processes.

In the file that `init` writes, prose begins with "# ", and a line that is a setting without its # with "#" alone.
"""

import re
import shlex
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from common.address import Address
from common.config import Scene, read_scene
from common.config_sections import default_quorum
from common.errors import BadInput, LabanmeshError, reason_of
from common.lifecycle import stop_on_signals
from deploy.doctor.cameras import Webcam, webcams
from deploy.doctor.network import EndpointParts, listener_on, try_to_listen
from deploy.launcher import Job, Launcher, RestartPolicy
from deploy.meeting import open_meeting

START_TOGETHER_S = 2.0
"""Recordings begin this long after the launcher at the earliest: fusion and hubs run then. They begin when the last
observer is ready, which takes longer if a tracker does."""
EACH_OBSERVER_S = 0.2
HUBS = {"mqtt": ("hub", "mqtt"), "dashboard": ("dashboard",)}
FAILURES_WITH_AN_END = 5
"""A scene that ends by itself gives up a failing observer after so many failures in a row."""
PORT_TIMEOUT_S = 3.0
"""Processes of a scene whose `up` was killed end by themselves, and free their ports, within this time."""
PORT_RETRY_S = 0.1
DEFAULT_NAME = "home"
VIEWS = {1: ("door",), 2: ("yaw:30", "yaw:-30"), 3: ("door", "yaw:45", "yaw:-45")}
"""Where so many cameras usually stand; more than three stand in the corners."""
CORNERS = ("yaw:45", "yaw:-45", "yaw:135", "yaw:-135")
COMMAND_WIDTH = 32
HEAD = """\
# A scene of labanmesh: its cameras, where they stand, where the processes meet, and when a movement is decided.
# Every process reads this file; on several machines each has the same. All keys: docs/reference/scene.md.
#
# What to do next:
{steps}

scene = "{scene}"
# The movements, in the models' own order. If it is left out, the models bring it.
#vocabulary = ["lunging", "byebye"]
"""
OBSERVER = """
[observers.{name}]
{camera}
source = "{source}"
# Where it stands as seen from the performer: door (in front), wheel (to the right), yaw:DEG between, negative to the
# left; or a camera file of `labanmesh calibrate`. An estimate is enough to begin with: the model is learned for it.
view = "{view}"
# How body parts are found. Without the line: mediapipe, which finds bodies, where it is installed
# (pip install 'labanmesh[mediapipe]'), else camshift, which follows skin colour and needs nothing more.
#tracker = "mediapipe"
# The model file; this is its name without the line.
#model = "{name}.model"
# For mirrored pictures, as many webcams and phones take them.
#mirrored = true
# What it sees, so many times a second, on the dashboard and after a click. Without the line no picture is ever sent.
#picture_hz = 2
"""
NO_CAMERA = """\
# No camera was found here, so this is an example. Other sources, one observer each:
# "rtsp://camera.local/stream" (a network camera), "film.mp4" (a recording), "motion.npz" (recorded motion)."""
TAIL = """
[mesh]
# machine: all processes on this one. router: on several; then `labanmesh router tcp/0.0.0.0:7447` on one of them, and
# its address here. Encryption and access rules: labanmesh secure --help.
mode = "machine"
#endpoint = "tcp/127.0.0.1:7447"

[fusion]
# How many observers must agree before there is a verdict; by default half of them.
#quorum = {quorum}
# How probable a movement must be, and for how long (seconds).
#threshold = 0.6
#hold_s = 0.1
"""


def up(
    scene: Annotated[Path, typer.Argument(help="The scene file (TOML).")],
    for_s: Annotated[
        float | None, typer.Option("--for", metavar="SECONDS", min=0, help="End by itself after this time.")
    ] = None,
    exit_when_done: Annotated[
        bool, typer.Option("--exit-when-done", help="End when all recordings have been played.")
    ] = False,
) -> int:
    """Run all processes that a scene file names on this machine: fusion, each observer, hubs; supervised.

    A process that fails is started again, ever later. The log on stderr has all their lines, each with the process's
    name. SIGTERM or Ctrl-C ends all.

    Example: labanmesh up scene.toml

    Example: labanmesh up scene.toml --exit-when-done
    """
    config = read_scene(scene)
    if config.mesh.mode == "process":
        raise BadInput(f"{scene}: mesh.mode = 'process': several processes cannot meet; choose machine or router")
    for name in _fed_by_hand(config):
        command = f"TRACKER | labanmesh observe {scene} {name}"
        print(f"{name}: reads tracks from its standard input, start it by hand: {command}", file=sys.stderr)
    started = jobs(scene, config)
    require_free_ports(config, len(started))
    start_ns = time.time_ns() + round(playback_delay_s(config) * 1e9)
    with stop_on_signals() as stop, tempfile.TemporaryDirectory(prefix="labanmesh-") as folder:
        meeting = open_meeting(Path(folder), config)
        launcher = Launcher(
            with_ports(started, config.metrics.listen),
            environment={
                "LABANMESH_PLAYBACK_START_NS": str(start_ns),
                "LABANMESH_PLAYBACK_MEETING": str(meeting),
                **_memory(config, Path(folder)),
            },
            policy=RestartPolicy(failures=FAILURES_WITH_AN_END if exit_when_done else None),
            ended=lambda name: (meeting / f"{name}.awaited").unlink(missing_ok=True),
        )
        timer = threading.Timer(for_s or 0, stop.set)
        timer.daemon = True
        if for_s is not None:
            timer.start()
        status = launcher.run(stop, exit_when_done=exit_when_done, linger_s=config.fusion.drop_s)
        timer.cancel()
    if status:
        raise LabanmeshError(f"{scene}: not all processes could do their work; the log above names the causes")
    return 0


def playback_delay_s(scene: Scene) -> float:
    """How long after the launcher recordings and films begin at the earliest."""
    return START_TOGETHER_S + EACH_OBSERVER_S * len(scene.roster)


@dataclass(frozen=True, slots=True)
class ScenePort:
    """A port on which a process of the scene listens. key: of the scene file. address: as it stands there."""

    key: str
    address: str
    parts: EndpointParts

    def fault(self) -> str:
        """Why no process of this user can listen there now, one line with the way out; "" where one can."""
        local, unusable = try_to_listen(self.parts)
        setting = f"{self.key} = {self.address!r}"
        if not local:
            return f"{setting}: not an address of this machine; write 127.0.0.1, or 0.0.0.0 for every interface"
        if not unusable:
            return ""
        taken = "in use" in unusable
        cause = f"taken by {listener_on(self.parts.port) or 'another program'}" if taken else f"not usable: {unusable}"
        way_out = "stop that program, or choose another port" if taken else "choose another port, above 1023"
        return f"{setting}: port {self.parts.port} is {cause}; {way_out}"


def require_free_ports(scene: Scene, processes: int) -> None:
    """Raises LabanmeshError, one line with the way out, when a port of the scene is still taken after PORT_TIMEOUT_S.

    processes: how many the scene has on this machine; with [metrics] each needs a port.
    """
    end_s = time.monotonic() + PORT_TIMEOUT_S
    while faults := [fault for port in _ports(scene, processes) if (fault := port.fault())]:
        if time.monotonic() > end_s:
            raise LabanmeshError(faults[0])
        time.sleep(PORT_RETRY_S)


def _ports(scene: Scene, processes: int) -> Iterator[ScenePort]:
    endpoint = EndpointParts.of(scene.mesh.endpoint)
    if scene.mesh.mode == "machine" and endpoint.host:
        yield ScenePort("mesh.endpoint", scene.mesh.endpoint, endpoint)
    if scene.metrics.listen:
        first = Address.parse(scene.metrics.listen, "metrics.listen")
        for address in map(first.after, range(processes)):
            yield ScenePort("metrics.listen", str(address), EndpointParts("tcp", address.host, address.port))
    if "dashboard" in scene.hub.start:
        address = Address.parse(scene.hub.dashboard.listen, "hub.dashboard.listen")
        yield ScenePort("hub.dashboard.listen", str(address), EndpointParts("tcp", address.host, address.port))


def _memory(scene: Scene, folder: Path) -> dict[str, str]:
    """A fusion service that is restarted continues its movement. The folder lasts as long as the launcher."""
    return {} if scene.fusion.memory is not None else {"LABANMESH_FUSION_MEMORY": str(folder)}


def jobs(path: Path, scene: Scene) -> list[Job]:
    """The processes of a scene: its fusion services, the observers that do not read their standard input, its hubs.

    A router, if the mesh has one, is started apart.
    """
    python = [sys.executable, "-P", "-m", "labanmesh"]
    fuse = [Job("[fuse]", [*python, "fuse", str(path)], lasting=True)]
    fuse += [
        Job(f"[fuse {name}]", [*python, "fuse", str(path), "--id", name], lasting=True) for name in scene.fusion.standby
    ]
    by_hand = _fed_by_hand(scene)
    observe = [Job(name, [*python, "observe", str(path), name]) for name in scene.roster if name not in by_hand]
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


def init(
    file: Annotated[Path, typer.Argument(help="The scene file to write; it must not exist yet.")] = Path("scene.toml"),
) -> None:
    """Write a commented scene file for the cameras of this machine, to be read and changed. Overwrites nothing.

    Example: labanmesh init livingroom.toml
    """
    if not file.name.isprintable():
        raise BadInput(f"{str(file)!r}: this name cannot be printed; choose another")
    present = [webcam for webcam in webcams() if webcam.access != "absent"]
    text = scene_text(present, shlex.quote(file.name), _scene_name(file))
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError:
        raise BadInput(f"{file}: exists already and is not overwritten; name another file") from None
    except OSError as error:
        raise LabanmeshError(f"cannot write {file}: {reason_of(error)}. Name another file") from None
    for webcam in present:
        typer.echo(f"{webcam.place}: {webcam.name or 'a webcam'}")
    if not present:
        typer.echo("no webcam found: the file has an example instead, change its source")
    typer.echo(f"wrote {file}; read it, then: labanmesh doctor {shlex.quote(str(file))}")


def scene_text(webcams: Sequence[Webcam], file: str, scene: str) -> str:
    """The file's text for these cameras; without any, an example with one.

    file: the file's name, for the commands in the comments. scene: a legal id.
    """
    names = [f"cam{number}" for number in range(1, max(len(webcams), 1) + 1)]
    views = VIEWS.get(len(names), CORNERS)
    placed = [(name, views[number % len(views)]) for number, name in enumerate(names)]
    sources = [webcam.place.removeprefix("/dev/video") for webcam in webcams] or ["0"]
    head = HEAD.format(steps="\n".join(_steps(file, sources, placed)), scene=scene)
    descriptions = [f"# {_maker_name(webcam)}, {webcam.place}" for webcam in webcams] or [NO_CAMERA]
    observers = [
        OBSERVER.format(name=name, camera=camera, source=source, view=view)
        for (name, view), camera, source in zip(placed, descriptions, sources, strict=True)
    ]
    return head + "".join(observers) + TAIL.format(quorum=default_quorum(len(names)))


def _scene_name(file: Path) -> str:
    """The file's name, where that is a legal id and not the default of the command."""
    name = re.sub(r"[^a-z0-9_-]+", "-", file.stem.lower()).strip("-")[:64]
    return name if name and name != "scene" else DEFAULT_NAME


def _maker_name(webcam: Webcam) -> str:
    """The maker's name for it, on one line."""
    return "".join(filter(str.isprintable, webcam.name)) or "a webcam"


def _steps(file: str, sources: Sequence[str], placed: Sequence[tuple[str, str]]) -> Iterator[str]:
    yield _step("1.", f"labanmesh doctor {file}", "what is missing, and what to do about it")
    yield _step("2.", f"labanmesh look {sources[0]}", "what that camera sees, and how well it can be used")
    yield from (_step("", f"labanmesh look {source}") for source in sources[1:])
    yield _step("3.", f"labanmesh up {file}", "all processes, on this machine; the cameras need no model yet")
    yield _step("4.", f"labanmesh teach {file} wave point clap", "your movements, in another terminal")
    yield _step("5.", f"labanmesh watch {file}", "the observers' posteriors, and the verdicts")
    yield "# Or learn a model for each observer from recordings in 3-D (labanmesh record, labanmesh import):"
    yield from (_step("", f"labanmesh learn motion.npz --view {view} -o {name}.model") for name, view in placed)


def _step(number: str, command: str, what: str = "") -> str:
    return f"# {number:<2} {command:<{COMMAND_WIDTH}} {what}".rstrip()
