"""The router's life: it relays until it is stopped, and opens anew when its rules or certificates have changed.

1. New rules that cannot be used are told once, and the old ones stay in force.
2. Opening anew closes all links, so that nobody goes on under rules that are gone; clients come back by themselves.
"""

import json
import logging
import sys
import threading
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

from common.config import MeshConfig, read_scene
from common.credentials import require_credentials
from common.errors import BadInput, LabanmeshError
from common.link import Link
from common.notify import Notifier
from common.zenoh_settings import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, nested, settings
from deploy.security.issuing import FOLDER, REGISTER, read_register
from deploy.security.router_config import listening, router_config

Stamps = tuple[tuple[int, int] | None, ...]
LOOK_S = 1.0
REOPEN_S = 10.0
"""How long a port may stay taken after the session that had it was closed."""
log = logging.getLogger("labanmesh.deploy")


def route(rules: "Rules", stop: threading.Event, look_s: float = LOOK_S) -> None:
    """Relay as `rules` say until `stop` is set; raises LabanmeshError when they cannot be used at the start."""
    text = rules.text()
    notifier, patience_s = Notifier.from_environment(), 0.0
    try:
        while not stop.is_set():
            with _opened(text, rules, stop, patience_s) as link:
                print(f"labanmesh router: listening on {link.locator}", file=sys.stderr, flush=True)
                notifier.ready()
                text, patience_s = _until_changed(rules, text, link, notifier, stop, look_s), REOPEN_S
    finally:
        notifier.stopping()


class Rules:
    """Where a router's configuration comes from: the files that it is made of, and the credentials that it names."""

    def __init__(
        self, where: str, make: Callable[[], str], files: Sequence[Path], credentials: Sequence[Path] = ()
    ) -> None:
        self.where, self._make = where, make
        self._files, self._credentials = files, credentials

    def text(self) -> str:
        """The configuration as it is now, JSON5; raises BadInput or LabanmeshError, one line."""
        text = self._make()
        Link.check_router(text, self.where)
        return text

    def stamps(self) -> tuple[Stamps, Stamps]:
        """Of the files and of the credentials: other ones when one of them was written."""
        return tuple(map(_stamp, self._files)), tuple(map(_stamp, self._credentials))


def plain_rules(endpoint: str) -> Rules:
    """None: whoever reaches `endpoint` may do everything."""
    mesh = MeshConfig(mode="router")
    text = json.dumps(nested(settings(mesh, "router", [endpoint], 0.0)))
    return Rules(f"endpoint {endpoint!r}", lambda: text, [])


def rules_in_file(path: Path) -> Rules:
    """A whole Zenoh configuration in a file (JSON5)."""

    def make() -> str:
        try:
            return path.read_text(encoding="utf-8")
        except OSError as error:
            said = (error.strerror or str(error)).lower()
            raise BadInput(f"{path}: {said}; `labanmesh secure rules SCENE` makes such a file") from None

    return Rules(str(path), make, [path])


def rules_of_scene(path: Path, endpoint: str = "") -> Rules:
    """Made from the scene file and, for a secured scene, the authority's register in secure/ beside it.

    endpoint: where to listen; "": where the scene's machines look for their router.
    """
    scene = read_scene(path)
    register_file = path.absolute().parent / FOLDER / REGISTER
    folder = Path(scene.mesh.credentials)
    credentials = [folder / name for name in (AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE)]

    def make() -> str:
        now = read_scene(path)
        if now.mesh.mode != "router":
            raise BadInput(f"{path}: mesh.mode = {now.mesh.mode!r}: its processes look for no router; say router")
        listen = [endpoint or listening(now.mesh.endpoint)]
        if not now.mesh.credentials:
            return router_config(now, None, listen)
        if not listen[0].startswith(("tls/", "quic/")):
            raise BadInput(f"{listen[0]!r}: not encrypted, and {path} wants credentials; write tls/HOST:PORT")
        require_credentials(Path(now.mesh.credentials), "router", "", datetime.now(UTC))
        return router_config(now, read_register(register_file, now), listen)

    return Rules(str(path), make, [path, register_file], credentials if scene.mesh.credentials else [])


def _opened(text: str, rules: Rules, stop: threading.Event, patience_s: float) -> Link:
    """The router's session; after a change its port may be taken for a moment yet."""
    waited_s = 0.0
    while True:
        try:
            return Link.router(text, rules.where)
        except LabanmeshError:
            if waited_s >= patience_s or stop.wait(0.1):
                raise
            waited_s += 0.1


def _until_changed(
    rules: Rules, text: str, link: Link, notifier: Notifier, stop: threading.Event, look_s: float
) -> str:
    """Waits until `stop`, or until the files say something else than `text`; returns what they say then."""
    seen = opened = rules.stamps()
    while not stop.wait(look_s):
        if _answers(link):
            notifier.alive()
        if (now := rules.stamps()) == seen:
            continue
        seen = now
        try:
            new = rules.text()
        except LabanmeshError as error:
            log.warning("changed rules cannot be used, the old ones stay in force: %s", error)
            continue
        # A scene file may change in what is no business of the router's.
        if new != text or now[1] != opened[1]:
            log.info("%s: changed; opening anew", rules.where)
            return new
    return text


def _answers(link: Link) -> bool:
    try:
        return bool(link.locator)
    except LabanmeshError:
        return False


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_ino
