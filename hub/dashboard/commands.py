"""The verb `labanmesh dashboard`: a scene, or a capture of one, as a page in the browser."""

import secrets
import shlex
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.address import ANY_HOST, Address
from common.command_options import ForSeconds
from common.config import Scene, read_scene
from common.errors import BadInput, reason_of
from common.lifecycle import log_to_stderr, stop_on_signals
from common.link import Link
from common.notify import Notifier
from common.tracker_choice import PHONE
from hub.dashboard.placement import azimuth_of, azimuth_of_camera, floor_positions
from hub.instrumentation import instrumented
from hub.lan import bound_socket, lan_address
from hub.session import has_right

if TYPE_CHECKING:
    from hub.dashboard.access import AccessControl
    from hub.dashboard.history import CaptureTimeline
    from hub.dashboard.page_data import PageSetup

UNMISTAKABLE = "abcdefghijkmnpqrstuvwxyz23456789"
"""Letters and digits that nobody takes for another on a phone."""


def dashboard(
    scene: Annotated[Path | None, typer.Argument(help="The scene file, as given to observe and fuse.")] = None,
    capture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Show this capture (.mcap) instead of a running scene.")
    ] = None,
    listen: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="The address of the page, instead of hub.dashboard.listen.")
    ] = None,
    token_file: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A file with the token, instead of the scene file's.")
    ] = None,
    teach: Annotated[
        bool, typer.Option("--teach", help="Whoever has the token may also teach, at /teach; made if there is none.")
    ] = False,
    for_s: ForSeconds = None,
) -> None:
    """Show the scene as one page in the browser: the judges on the tatami, the verdicts, and why. Ctrl-C ends it.

    It only reads, unless --teach lets those who have the token teach. Where other machines can reach it, it asks for
    a token.

    Example: labanmesh dashboard scene.toml

    Example: labanmesh dashboard scene.toml --teach --listen 0.0.0.0:8420

    Example: labanmesh dashboard --capture monday.mcap --listen 127.0.0.1:0
    """
    if (scene is None) == (capture is None):
        raise BadInput("dashboard: name either a scene file or a capture, e.g. labanmesh dashboard scene.toml")
    # Starlette is not needed for --help.
    from hub.dashboard.access import LISTEN_KEY

    config, timeline = (read_scene(scene), None) if scene else _read_capture(capture or Path())
    settings = config.hub.dashboard if scene else type(config.hub.dashboard)()
    address = Address.parse(listen or settings.listen, LISTEN_KEY)
    configured = config.place(settings.token_file) if settings.token_file else None
    access = _access(address, token_file or configured, bool(scene) and (teach or settings.teach))
    _serve(_setup(config, timeline, access, scene), config, timeline, address, access, for_s)


def _serve(
    setup: "PageSetup",
    scene: Scene,
    timeline: "CaptureTimeline | None",
    address: Address,
    access: "AccessControl",
    for_s: float | None,
) -> None:
    from hub.dashboard.access import LISTEN_KEY
    from hub.dashboard.serving import ServingRun, serve_capture, serve_scene

    log_to_stderr()
    with (
        bound_socket(address, LISTEN_KEY) as port,
        stop_on_signals(for_s) as stop,
        Notifier.from_environment() as supervisor,
    ):
        own = Address(address.host, port.getsockname()[1])
        serving = ServingRun(stop, supervisor.alive)
        if timeline is not None:
            print(f"http://{own.reachable}/ shows a capture of scene {scene.scene}", flush=True)
            serve_capture(port, access, setup, timeline, serving)
            return
        with (
            instrumented([scene], "dashboard") as instrumentation,
            Link.open(scene.mesh, "hub", scene=scene.scene, stop=stop) as link,
        ):
            serving.record = instrumentation.record
            print(f"http://{own.reachable}/ shows scene {scene.scene}", flush=True)
            for line in _teach_lines(scene, setup.file, access, own):
                print(line, flush=True)
            serve_scene(port, access, setup, scene, link, serving)


def _teach_lines(scene: Scene, file: str, access: "AccessControl", own: Address) -> Iterator[str]:
    """Where to teach; the token is printed only if it was made for this run."""
    from hub.dashboard.access import is_loopback
    from hub.dashboard.serving import NO_TEACH_RIGHT

    if not access.teaches:
        return
    if not has_right(scene, "teach"):
        yield NO_TEACH_RIGHT
        return
    made = f"#{access.made_token}" if access.made_token else ""
    host = lan_address() if own.host in ANY_HOST else own.host
    yield f"teach at http://{Address(host, own.port)}/teach{made}"
    if is_loopback(own):
        yield f"for a phone: labanmesh dashboard {file} --teach --listen 0.0.0.0:{own.port}"


def _access(address: Address, path: Path | None, teaches: bool) -> "AccessControl":
    """Access to the page and to teaching. Teaching without a token file makes a new token."""
    from hub.dashboard.access import AccessControl, is_loopback

    if path is not None or not teaches:
        token = _token(address, path)
        return AccessControl(token, token if teaches else None)
    made = "-".join("".join(secrets.choice(UNMISTAKABLE) for _ in range(4)) for _ in range(4))
    return AccessControl(None if is_loopback(address) else made, made, made)


def _read_capture(path: Path) -> tuple[Scene, "CaptureTimeline"]:
    from common.capture_file import CaptureFile
    from hub.dashboard.history import CaptureTimeline

    began_s = time.monotonic()
    file = CaptureFile(path)
    timeline = CaptureTimeline(file.scene, file.records())
    if not timeline.began_ns:
        raise BadInput(f"{path}: holds no messages; capture a running scene with labanmesh capture")
    print(f"{path}: {timeline.span_s:.0f} s, read in {time.monotonic() - began_s:.1f} s", flush=True)
    return file.scene, timeline


def _token(address: Address, path: Path | None) -> str | None:
    from hub.dashboard.access import LISTEN_KEY, checked_token, is_loopback

    if path is None:
        if not is_loopback(address):
            raise BadInput(
                f"{LISTEN_KEY} = {str(address)!r}: other machines can reach that, and hub.dashboard.token_file is not "
                "set; --token-file FILE names a token, --teach makes one, or listen on 127.0.0.1"
            )
        return None
    where = f"hub.dashboard.token_file = {path}"
    try:
        return checked_token(path.read_text(encoding="utf-8"), where)
    except (OSError, UnicodeDecodeError) as error:
        reason = reason_of(error) if isinstance(error, OSError) else "not text"
        raise BadInput(f"{where}: {str(reason).lower()}; make it: openssl rand -hex 16 > {path}") from None


def _setup(scene: Scene, timeline: "CaptureTimeline | None", access: "AccessControl", file: Path | None) -> "PageSetup":
    from hub.dashboard.page_data import PageSetup

    views = {name: observer.view for name, observer in scene.observers.items()}
    azimuths = {name: _azimuth(scene, view) for name, view in views.items()}
    span_s, began_ns = (None, 0) if timeline is None else (timeline.span_s, timeline.began_ns)
    pictures = {name: each.picture_hz for name, each in scene.observers.items() if each.picture_hz and not timeline}
    return PageSetup(
        scene.scene, floor_positions(views, azimuths), scene.fusion.quorum, span_s, began_ns, pictures,
        access.teaches, "" if file is None else shlex.quote(str(file)), scene.fusion.threshold,
        () if timeline else tuple(name for name, each in scene.observers.items() if each.source == PHONE),
        bool(scene.history.file) and not timeline,
    )  # fmt: skip


def _azimuth(scene: Scene, view: str) -> float | None:
    """The angle of a view, also from its camera file; None when there is none or the file cannot be read."""
    if not view.endswith(".toml"):
        return azimuth_of(view)
    try:
        return azimuth_of_camera(tomllib.loads(scene.place(view).read_text(encoding="utf-8"))["projective_matrix"])
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, KeyError):
        return None
