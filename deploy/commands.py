"""The verb `labanmesh up`: all processes of a scene on this machine, once for each user."""

import fcntl
import os
import stat
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Annotated

import typer

from common.address import Address
from common.command_options import ForSeconds
from common.config import Scene, read_scene
from common.errors import BadInput, LabanmeshError, reason_of
from common.lifecycle import stop_on_signals
from common.tracker_choice import is_recording
from deploy.doctor.network import EndpointParts, listener_on, try_to_listen
from deploy.hubs import EVENTS, hub_words
from deploy.launcher import Job, Launcher

START_TOGETHER_S = 2.0
"""Recordings begin this long after the launcher at the earliest: fusion and hubs run then. They begin when the last
observer is ready, which takes longer if a tracker does."""
EACH_OBSERVER_S = 0.2
FAILURES_WITH_AN_END = 5
"""A scene that ends by itself gives up a failing observer after so many failures in a row."""
PORT_TIMEOUT_S = 3.0
"""Processes of a scene whose `up` was killed end by themselves, and free their ports, within this time."""
PORT_RETRY_S = 0.1


def up(
    scene: Annotated[Path, typer.Argument(help="The scene file (TOML).")],
    for_s: ForSeconds = None,
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
    with (
        only_once(config, runtime_folder(os.environ)),
        stop_on_signals(for_s) as stop,
        tempfile.TemporaryDirectory(prefix="labanmesh-") as folder,
    ):
        require_free_ports(config, len(started))
        delay_s = START_TOGETHER_S + EACH_OBSERVER_S * len(config.roster)
        start_ns = time.time_ns() + round(delay_s * 1e9)
        barrier = open_start_barrier(Path(folder), config)
        launcher = Launcher(
            with_ports(started, config.metrics.listen),
            environment={
                "LABANMESH_PLAYBACK_START_NS": str(start_ns),
                "LABANMESH_PLAYBACK_MEETING": str(barrier),
                # A restarted fusion service continues its movement; the folder ends with the launcher.
                **({} if config.fusion.memory is not None else {"LABANMESH_FUSION_MEMORY": folder}),
            },
            most_failures=FAILURES_WITH_AN_END if exit_when_done else None,
            ended=lambda name: (barrier / f"{name}.awaited").unlink(missing_ok=True),
        )
        launcher.run(stop, exit_when_done=exit_when_done, linger_s=config.fusion.drop_s)
    if gone := launcher.given_up:
        raise LabanmeshError(f"{scene}: gave up {', '.join(gone)}; the log above names the causes")
    return 0


def open_start_barrier(folder: Path, scene: Scene) -> Path:
    """A new folder below `folder`, with a file ID.awaited for each observer that plays a recording in real time.

    There they wait, so that all begin together (observer/motion/playback.py).
    """
    barrier = folder / "barrier"
    barrier.mkdir()
    for observer, section in scene.observers.items():
        if section.speed and is_recording(section.source):
            (barrier / f"{observer}.awaited").touch()
    return barrier


@dataclass(frozen=True, slots=True)
class ScenePort:
    """A port on which a process of the scene listens. key: of the scene file. address: as it stands there."""

    key: str
    address: str
    parts: EndpointParts

    def fault(self) -> str:
        """Why this user cannot listen there now: one line with the way out; "" if they can."""
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
    hubs = [Job(f"[{name}]", [*python, *hub_words(name), str(path)], lasting=True) for name in scene.hub.start]
    if scene.history.file or scene.notify:
        hubs.append(Job("[events]", [*python, *EVENTS, str(path)], lasting=True))
    return [*fuse, *observe, *hubs]


def with_ports(jobs: Sequence[Job], listen: str) -> list[Job]:
    """The jobs with a port each for /metrics, counted up from the port of `listen`; without ports if `listen` is ""."""
    if not listen:
        return list(jobs)
    first = Address.parse(listen, "metrics.listen")
    ports = {job.name: {"LABANMESH_METRICS_LISTEN": str(first.after(n))} for n, job in enumerate(jobs)}
    return [replace(job, environment={**job.environment, **ports[job.name]}) for job in jobs]


def _fed_by_hand(scene: Scene) -> list[str]:
    return [name for name in scene.roster if scene.observer(name).source == "-"]


@contextmanager
def only_once(scene: Scene, folder: Path) -> Iterator[None]:
    """Until the block is left no other `up` of this user can enter it with this scene at the same meeting place.

    The scene counts, not its file: editors replace files, and any reader of a file can lock it. folder: the user's own,
    for the lock. Raises LabanmeshError, one line with the way out, if another one has entered. One
    that was killed does not count.
    """
    place = sha256(f"{scene.mesh.prefix} {scene.mesh.endpoint}".encode()).hexdigest()[:8]
    file = folder / f"labanmesh-{scene.scene}-{place}.lock"
    try:
        number = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    except OSError as error:
        raise LabanmeshError(
            f"cannot write {file}: {reason_of(error)}; name a folder of yours as XDG_RUNTIME_DIR"
        ) from None
    try:
        _lock(number, scene.scene)
        yield
    finally:
        os.close(number)


def _lock(number: int, scene: str) -> None:
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise LabanmeshError(f"scene {scene!r}: labanmesh up runs already with it; stop that one first") from None


def runtime_folder(environment: Mapping[str, str], run: Path = Path("/run/user")) -> Path:
    """The folder for what runs, which only this user can write: XDG_RUNTIME_DIR, RUN/UID, or a new temporary one.

    Raises LabanmeshError, one line, if somebody else has taken the temporary one.
    """
    user = os.getuid()
    for folder in (Path(environment.get("XDG_RUNTIME_DIR") or run / str(user)), run / str(user)):
        if _is_own(folder):
            return folder
    folder = Path(tempfile.gettempdir()) / f"labanmesh-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise LabanmeshError(
            f"cannot write {folder}: {reason_of(error)}; name a folder of yours as XDG_RUNTIME_DIR"
        ) from None
    if not _is_own(folder):
        raise LabanmeshError(f"{folder}: others can write there; name a folder of yours as XDG_RUNTIME_DIR")
    return folder


def _is_own(folder: Path) -> bool:
    """Whether it is a folder of this user, no link, that nobody else can write."""
    try:
        status = folder.lstat()
    except OSError:
        return False
    closed = not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and closed
