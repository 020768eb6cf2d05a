"""The verb `labanmesh dashboard`: a scene, or a capture of one, as a page in the browser."""

import time
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.address import Address
from common.config import read_scene
from common.errors import BadInput
from hub.dashboard.access import KEY, Gate, checked_token, is_loopback, must_have_token
from hub.dashboard.placement import azimuth_of, azimuth_of_camera, placed

if TYPE_CHECKING:
    from common.config import Scene
    from hub.dashboard.picture import Hall
    from hub.dashboard.tape import Tape


def dashboard(
    scene: Annotated[Path | None, typer.Argument(help="The scene file, as given to observe and fuse.")] = None,
    capture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Show this capture (.mcap) instead of a running scene.")
    ] = None,
    listen: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Where the page is, instead of hub.dashboard.listen.")
    ] = None,
    token_file: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The word that browsers must know, instead of the scene file's.")
    ] = None,
    for_s: Annotated[
        float | None, typer.Option("--for", metavar="SECONDS", min=0, help="End by itself after so long.")
    ] = None,
) -> None:
    """The scene as one page in the browser: the judges on the tatami, the verdicts, and why. Ctrl-C ends it.

    It only reads. Where others can reach it, it asks for a token.

    Example: labanmesh dashboard scene.toml

    Example: labanmesh dashboard --capture monday.mcap --listen 127.0.0.1:0
    """
    if (scene is None) == (capture is None):
        raise BadInput("labanmesh dashboard: name a scene file, or a capture with --capture FILE, one of the two")
    named, tape = (read_scene(scene), None) if scene else _captured(capture or Path())
    configured = named.hub.dashboard if scene else type(named.hub.dashboard)()
    address = Address.parse(listen or configured.listen, KEY)
    gate = Gate(_token(address, token_file, named, own=scene is not None))
    _serve(named, tape, address, gate, for_s)


def _serve(scene: "Scene", tape: "Tape | None", address: Address, gate: Gate, for_s: float | None) -> None:
    from common.lifecycle import log_to_stderr, stop_on_signals
    from common.link import Link
    from common.notify import Notifier
    from hub.dashboard.serving import Run, bound, serve_scene, serve_tape
    from hub.telling import telling

    log_to_stderr()
    with bound(address) as port, stop_on_signals() as stop, Notifier.from_environment() as supervisor:
        where, hall = Address(address.host, port.getsockname()[1]).reachable, _hall(scene, tape)
        run = Run(stop, for_s, supervisor.alive)
        if tape is not None:
            print(f"http://{where}/ shows a capture of scene {scene.scene}", flush=True)
            serve_tape(port, gate, hall, tape, run)
            return
        with telling([scene], "dashboard") as teller, Link.open(scene.mesh, "hub", scene=scene.scene) as link:
            run.heard = teller.heard
            print(f"http://{where}/ shows scene {scene.scene}", flush=True)
            serve_scene(port, gate, hall, scene, link, run)


def _captured(path: Path) -> tuple["Scene", "Tape"]:
    from common.capture_file import CaptureFile
    from hub.dashboard.tape import Tape

    began_s = time.monotonic()
    file = CaptureFile(path)
    tape = Tape(file.scene, file.records())
    if not tape.began_ns:
        raise BadInput(f"{path}: nothing was heard in it")
    print(f"{path}: {tape.span_s:.0f} s, read in {time.monotonic() - began_s:.1f} s", flush=True)
    return file.scene, tape


def _token(address: Address, chosen: Path | None, scene: "Scene", own: bool) -> str | None:
    """The word of the token file; None where everybody of this machine may read."""
    named = scene.hub.dashboard.token_file if own else ""
    path = chosen or (scene.place(named) if named else None)
    if path is None:
        if not is_loopback(address):
            raise must_have_token(address)
        return None
    where = f"hub.dashboard.token_file = {path}"
    try:
        return checked_token(path.read_text(encoding="utf-8"), where)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not text"
        raise BadInput(f"{where}: {str(reason).lower()}; make it: openssl rand -hex 16 > {path}") from None


def _hall(scene: "Scene", tape: "Tape | None") -> "Hall":
    from hub.dashboard.picture import Hall

    views = {name: observer.view for name, observer in scene.observers.items()}
    azimuths = {name: _azimuth(scene, view) for name, view in views.items()}
    span_s, began_ns = (None, 0) if tape is None else (tape.span_s, tape.began_ns)
    return Hall(scene.scene, placed(views, azimuths), scene.fusion.quorum, span_s, began_ns)


def _azimuth(scene: "Scene", view: str) -> float | None:
    """Where a view's camera stands, from its words or its camera file; a file that is not here says nothing."""
    if not view.endswith(".toml"):
        return azimuth_of(view)
    try:
        return azimuth_of_camera(tomllib.loads(scene.place(view).read_text(encoding="utf-8"))["projective_matrix"])
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, KeyError):
        return None
