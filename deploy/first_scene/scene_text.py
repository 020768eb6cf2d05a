"""The text of a first scene file. Pure.

Prose begins with "# ", and a line that is a setting without its # with "#" alone.
"""

import itertools
import json
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from common.config_sections import default_quorum

SCENE_VIEWS = {1: ("door",), 2: ("yaw:30", "yaw:-30"), 3: ("door", "yaw:45", "yaw:-45")}
"""Where so many cameras usually stand; more than three stand in the corners."""
CORNER_VIEWS = ("yaw:45", "yaw:-45", "yaw:135", "yaw:-135")
COMMAND_WIDTH = 43
SCHEMA_FILE = ".scene.schema.json"
"""Beside the scene file, for editors."""
SCENE_HEAD = """\
#:schema ./{schema}
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
source = {source}
# Where it stands as seen from the performer: door (in front), wheel (to the right), yaw:DEG between, negative to the
# left; or a file of `labanmesh camera calibrate`. An estimate is enough to begin with: the model is learned for it.
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

[hub]
# For Home Assistant and others, over an MQTT broker (docs/guide/home.md): `labanmesh up` then starts this hub too.
#start = ["mqtt"]

[hub.mqtt]
#host = "homeassistant.local"
#username = "labanmesh"
#password_file = "mqtt-password"
"""


@dataclass(frozen=True, slots=True)
class FirstCamera:
    """A camera of the file. source: as in the scene file. comment: what it is. film: it is played again and again.

    phone: a phone will be the camera, which `labanmesh camera look` cannot open.
    """

    source: str
    comment: str
    film: bool = False
    phone: bool = False


def scene_text(cameras: Sequence[FirstCamera], file: str, scene: str) -> str:
    """The file's text for these cameras; without any, an example with one.

    file: the file's name, for the commands in the comments. scene: a legal id.
    """
    cameras = cameras or [FirstCamera("0", NO_CAMERA)]
    names = [f"cam{number}" for number in range(1, len(cameras) + 1)]
    views = SCENE_VIEWS.get(len(names), CORNER_VIEWS)
    placed = [(name, views[number % len(views)]) for number, name in enumerate(names)]
    head = SCENE_HEAD.format(schema=SCHEMA_FILE, steps="\n".join(_steps(file, cameras, placed)), scene=scene)
    observers = [
        OBSERVER.format(name=name, camera=camera.comment, source=_in_toml(camera), view=view)
        for (name, view), camera in zip(placed, cameras, strict=True)
    ]
    return head + "".join(observers) + TAIL.format(quorum=default_quorum(len(names)))


def _in_toml(camera: FirstCamera) -> str:
    """The source as a TOML string, and that a film begins anew when it ends."""
    text = json.dumps(camera.source, ensure_ascii=False)
    return f"{text}\n# A film that begins anew when it ends.\nloop = true" if camera.film else text


def _steps(file: str, cameras: Sequence[FirstCamera], placed: Sequence[tuple[str, str]]) -> Iterator[str]:
    looks = [f"labanmesh camera look {shlex.quote(camera.source)}" for camera in cameras if not camera.phone]
    steps = [(f"labanmesh doctor {file}", "what is missing, and what to do about it")]
    steps += [(look, "what that camera sees, and how well it can be used") for look in looks[:1]]
    steps += [(look, "") for look in looks[1:]]
    steps += [(f"labanmesh up {file}", "all processes, on this machine; the cameras need no model yet")]
    if any(camera.phone for camera in cameras):
        steps += [(f"labanmesh phone {file}", "a code: the phone that reads it is the camera")]
    steps += [(f"labanmesh teach {file} wave point clap", "your movements, in another terminal")]
    steps += [(f"labanmesh watch {file}", "the observers' posteriors, and the verdicts")]
    numbers = itertools.count(1)
    for command, what in steps:
        yield _step(f"{next(numbers)}." if what else "", command, what)
    yield "# Or learn a model for each observer from recordings in 3-D (labanmesh camera record, labanmesh import):"
    yield from (_step("", f"labanmesh learn motion.npz --view {view} -o {name}.model") for name, view in placed)


def _step(number: str, command: str, what: str = "") -> str:
    return f"# {number:<2} {command:<{COMMAND_WIDTH}} {what}".rstrip()
