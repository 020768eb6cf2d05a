"""The text of a new scene file for the cameras of this machine, with comments that say what to do next. Pure.

Prose begins with "# "; what may be made a setting by taking the # away begins with "#" alone.
"""

from collections.abc import Iterator, Sequence

from common.config_sections import default_quorum
from deploy.doctor.cameras import Webcam

VIEWS = {1: ("door",), 2: ("yaw:30", "yaw:-30"), 3: ("door", "yaw:45", "yaw:-45")}
"""Where so many cameras usually stand; more than three stand in the corners."""
CORNERS = ("yaw:45", "yaw:-45", "yaw:135", "yaw:-135")

COMMAND_WIDTH = 32

HEAD = """\
# A scene of labanmesh: which cameras watch, how they see, where they meet, how they are judged.
# Every process reads this file; on several machines each has the same. All keys: docs/reference/scene.md.
#
# What to do next:
{steps}

scene = "{scene}"
# The movements, in the models' own order. Left out, the models bring it.
#vocabulary = ["lunging", "byebye"]
"""
OBSERVER = """
[observers.{name}]
{camera}
source = "{source}"
# Where it stands for whom it watches: door (in front), wheel (to the right), yaw:DEG between, negative to the left; or
# a camera file of `labanmesh calibrate`. Estimate it to begin with: the model is learned for what stands here.
view = "{view}"
# camshift follows skin colour and needs nothing more; mediapipe finds bodies, and is an install of its own:
# pip install 'labanmesh[mediapipe]'
tracker = "camshift"
# The model file; this is what it is called without the line.
#model = "{name}.model"
# As many webcams and selfies are.
#mirrored = true
"""
NO_CAMERA = """
# No camera was found here, so this is an example. Other sources, one observer each:
# "rtsp://camera.local/stream" (a network camera), "film.mp4" (a recording), "motion.npz" (recorded motion)."""
TAIL = """
[mesh]
# machine: all processes on this one. router: on several; then `labanmesh router tcp/0.0.0.0:7447` on one of them, and
# its address here. Encryption and access rules: labanmesh secure --help.
mode = "machine"
#endpoint = "tcp/127.0.0.1:7447"

[fusion]
# How many observers must agree before there is a verdict; left out: half of them.
#quorum = {quorum}
# How probable a movement must be, and for how long (seconds).
#threshold = 0.8
#hold_s = 0.2
"""


def scene_text(webcams: Sequence[Webcam], file: str, scene: str) -> str:
    """The file's text for these cameras; without any, an example with one.

    file: what the file is called, for the commands in the comments. scene: a legal id.
    """
    names = [f"cam{number}" for number in range(1, max(len(webcams), 1) + 1)]
    views = VIEWS.get(len(names), CORNERS)
    placed = [(name, views[number % len(views)]) for number, name in enumerate(names)]
    sources = [_source(webcam) for webcam in webcams] or ["0"]
    head = HEAD.format(steps="\n".join(_steps(file, sources, placed)), scene=scene)
    described = [f"# {_name(webcam)}, {webcam.place}" for webcam in webcams] or [NO_CAMERA.strip()]
    observers = [
        OBSERVER.format(name=name, camera=camera, source=source, view=view)
        for (name, view), camera, source in zip(placed, described, sources, strict=True)
    ]
    return head + "".join(observers) + TAIL.format(quorum=default_quorum(len(names)))


def _source(webcam: Webcam) -> str:
    return webcam.place.removeprefix("/dev/video")


def _name(webcam: Webcam) -> str:
    """As its maker calls it, on one line."""
    return "".join(filter(str.isprintable, webcam.name)) or "a webcam"


def _steps(file: str, sources: Sequence[str], placed: Sequence[tuple[str, str]]) -> Iterator[str]:
    yield _step("1.", f"labanmesh doctor {file}", "what is missing, and what to do about it")
    yield _step("2.", f"labanmesh look {sources[0]}", "what that camera sees, and how well it can be used")
    yield from (_step("", f"labanmesh look {source}") for source in sources[1:])
    yield _step("3.", "labanmesh record ...", "your movements as a motion archive, motion.npz; or labanmesh import")
    yield "# 4. One model for each observer, for where it stands:"
    yield from (_step("", f"labanmesh learn motion.npz --view {view} -o {name}.model") for name, view in placed)
    yield _step("5.", f"labanmesh up {file}", "all of it on this machine")
    yield _step("6.", f"labanmesh watch {file}", "in another terminal: who believes what, and the verdicts")


def _step(number: str, command: str, what: str = "") -> str:
    return f"# {number:<2} {command:<{COMMAND_WIDTH}} {what}".rstrip()
