"""The verb `labanmesh init`: a commented scene file for the cameras of this machine.

In the file prose begins with "# "; a line that becomes a setting when the # is removed begins with "#" alone.
"""

import re
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from common.config_sections import default_quorum
from common.errors import BadInput, LabanmeshError
from deploy.doctor.cameras import Webcam, webcams

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
# camshift follows skin colour and needs nothing more; mediapipe finds bodies, and is an install of its own:
# pip install 'labanmesh[mediapipe]'
tracker = "camshift"
# The model file; this is its name without the line.
#model = "{name}.model"
# For mirrored pictures, as many webcams and phones take them.
#mirrored = true
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
#threshold = 0.8
#hold_s = 0.2
"""


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
        reason = (error.strerror or str(error)).lower()
        raise LabanmeshError(f"cannot write {file}: {reason}. Name another file") from None
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
    yield _step("3.", "labanmesh record ...", "your movements as a motion archive, motion.npz; or labanmesh import")
    yield "# 4. One model for each observer, for the place where it stands:"
    yield from (_step("", f"labanmesh learn motion.npz --view {view} -o {name}.model") for name, view in placed)
    yield _step("5.", f"labanmesh up {file}", "all processes, on this machine")
    yield _step("6.", f"labanmesh watch {file}", "in another terminal: the observers' posteriors, and the verdicts")


def _step(number: str, command: str, what: str = "") -> str:
    return f"# {number:<2} {command:<{COMMAND_WIDTH}} {what}".rstrip()
