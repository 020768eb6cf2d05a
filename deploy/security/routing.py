"""The verb `labanmesh router`: it relays until it is stopped, and opens anew when rules or certificates have changed.

1. New rules that cannot be used are logged once, and the old ones stay in force.
2. Opening anew closes all links, so that no client continues under old rules; clients reconnect by themselves.
"""

import json
import logging
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from common.config import MeshConfig, scene_files
from common.credentials import require_credentials
from common.errors import BadInput, LabanmeshError, reason_of
from common.files import read_text
from common.lifecycle import log_to_stderr, stop_on_signals
from common.link import Link
from common.notify import Notifier
from common.zenoh_settings import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, nested, settings
from deploy.doctor.network import exposure
from deploy.security.issuing import REGISTER, SECURE_FOLDER, read_register, read_scenes
from deploy.security.router_config import listening, router_config

FileStamp = tuple[int, int, int] | None
Stamps = tuple[FileStamp, ...]
RULES_POLL_S = 1.0
REOPEN_S = 10.0
"""How long a port may stay taken after the session that had it was closed."""
ROUTER_RETRY_S = 0.1
log = logging.getLogger("labanmesh.deploy")


@dataclass(frozen=True, slots=True)
class RouterRules:
    """Where a router's configuration comes from. source: its name for people. make: returns it as JSON5.

    files: those that it is made of now. credentials: those that it names.
    """

    source: str
    make: Callable[[], str]
    files: Callable[[], Sequence[Path]]
    credentials: Sequence[Path] = ()

    def read(self) -> "Configuration":
        """The configuration as it is now; raises BadInput or LabanmeshError, one line."""
        # The time stamps first: a file that is written meanwhile is then noticed as a change.
        changes, text = self.changes(), self.make()
        Link.check_router(text, self.source)
        return Configuration(text, *changes)

    def changes(self) -> tuple[Stamps, Stamps]:
        """When the files and the credentials were last written."""
        try:
            files = self.files()
        except BadInput:  # a folder without scene files
            files = ()
        return tuple(map(_stamp, files)), tuple(map(_stamp, self.credentials))


@dataclass(frozen=True, slots=True)
class Configuration:
    """A router's configuration as JSON5, and when the files that it was made of, and names, were written."""

    text: str
    files: Stamps
    credentials: Stamps


def plain_rules(endpoint: str) -> RouterRules:
    """No access rules: every client that reaches `endpoint` may do everything."""
    text = json.dumps(nested(settings(MeshConfig(mode="router"), "router", [endpoint], 0.0)))
    return RouterRules(f"endpoint {endpoint!r}", lambda: text, tuple)


def rules_in_file(path: Path) -> RouterRules:
    """A whole Zenoh configuration in a file (JSON5)."""

    def make() -> str:
        try:
            return read_text(path)
        except OSError as error:
            raise BadInput(f"{path}: {reason_of(error)}; `labanmesh secure rules SCENE` makes such a file") from None
        except ValueError as error:
            raise BadInput(f"{path}: {error}; `labanmesh secure rules SCENE` makes such a file") from None

    return RouterRules(str(path), make, lambda: [path])


def rules_of_scenes(paths: Sequence[Path], endpoint: str = "") -> RouterRules:
    """Made from scene files, and for secured scenes the authority's register in secure/ beside the first one.

    endpoint: where to listen; "": where the scenes' machines look for their router.
    """
    mesh = read_scenes(paths)[0].mesh
    source = ", ".join(map(str, paths))
    register_file = next(scene_files(paths)).absolute().parent / SECURE_FOLDER / REGISTER
    folder = Path(mesh.credentials)
    credentials = [folder / name for name in (AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE)] if mesh.credentials else []

    def make() -> str:
        scenes = read_scenes(paths)
        mesh = scenes[0].mesh
        if mesh.mode != "router":
            raise BadInput(f"{source}: mesh.mode = {mesh.mode!r}: its processes look for no router; write 'router'")
        listen = [endpoint or listening(mesh.endpoint)]
        if not mesh.credentials:
            return router_config(scenes, None, listen)
        if not listen[0].startswith(("tls/", "quic/")):
            raise BadInput(f"{listen[0]!r}: not encrypted, and {source} wants credentials; write tls/HOST:PORT")
        require_credentials(Path(mesh.credentials), "router", "", datetime.now(UTC))
        return router_config(scenes, read_register(register_file, scenes), listen)

    return RouterRules(source, make, lambda: [*scene_files(paths), register_file], credentials)


def route(rules: RouterRules, stop: threading.Event, poll_s: float = RULES_POLL_S) -> None:
    """Relay under `rules` until `stop` is set; raises LabanmeshError when they cannot be used at the start."""
    current = rules.read()
    notifier, timeout_s = Notifier.from_environment(), 0.0
    try:
        while not stop.is_set():
            with _open(current.text, rules, stop, timeout_s) as link:
                print(f"labanmesh router: listening on {link.locator}", file=sys.stderr, flush=True)
                for fault in filter(None, map(exposure, Link.check_router(current.text, rules.source))):
                    log.warning("%s; labanmesh secure init SCENE, or listen on tcp/127.0.0.1:7447", fault)
                notifier.ready()
                current, timeout_s = _wait_for_change(rules, current, link, notifier, stop, poll_s), REOPEN_S
    finally:
        notifier.stopping()


def _open(text: str, rules: RouterRules, stop: threading.Event, timeout_s: float) -> Link:
    """The router's session; just after a change its port may still be taken."""
    waited_s = 0.0
    while True:
        try:
            return Link.router(text, rules.source)
        except LabanmeshError:
            if waited_s >= timeout_s or stop.wait(ROUTER_RETRY_S):
                raise
            waited_s += ROUTER_RETRY_S


def _wait_for_change(
    rules: RouterRules, current: Configuration, link: Link, notifier: Notifier, stop: threading.Event, poll_s: float
) -> Configuration:
    """Waits until `stop` is set or the configuration is no longer the current one; returns the new one."""
    last = current.files, current.credentials
    while not stop.wait(poll_s):
        if _answers(link):
            notifier.alive()
        if (now := rules.changes()) == last:
            continue
        last = now
        try:
            new = rules.read()
        except LabanmeshError as error:
            log.warning("changed rules cannot be used, the old ones stay in force: %s", error)
            continue
        # A scene file may change in ways that do not concern the router.
        if new.text != current.text or new.credentials != current.credentials:
            log.info("%s: changed; opening anew", rules.source)
            return new
    return current


def _answers(link: Link) -> bool:
    try:
        return bool(link.locator)
    except LabanmeshError:
        return False


def _stamp(path: Path) -> FileStamp:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def router(
    endpoint: Annotated[
        str, typer.Argument(help="Where it listens, by default on this machine alone; tcp/0.0.0.0:7447: for all.")
    ] = "",
    scene: Annotated[
        list[Path] | None,
        typer.Option(help="The scene file, or a folder of them; repeatable. A secured router admits their machines."),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="A whole Zenoh configuration (JSON5), as `labanmesh secure rules` prints it.")
    ] = None,
) -> None:
    """Run a Zenoh router, where the machines of a mesh meet. It relays, and keeps nothing.

    Scene files then say mode = "router" and this machine's address under [mesh] endpoint. The router notices changes
    in its files. It warns where other machines reach it without certificates.

    Example: labanmesh router tcp/0.0.0.0:7447

    Example: labanmesh router --scene scene.toml
    """
    if endpoint and "/" not in endpoint:
        raise BadInput(f"endpoint {endpoint!r}: PROTOCOL/HOST:PORT is expected, e.g. tcp/0.0.0.0:7447")
    if config is not None and (scene or endpoint):
        raise BadInput(f"--config {config}: it says itself where to listen; leave out ENDPOINT and --scene")
    log_to_stderr()
    if config is not None:
        rules = rules_in_file(config)
    else:
        rules = rules_of_scenes(scene, endpoint) if scene else plain_rules(endpoint or MeshConfig().endpoint)
    with stop_on_signals() as stop:
        route(rules, stop)
