"""Environments with the wheel and one extra each, files to work on, and the smallest job of each verb."""

import csv
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from studies.performer import perform, perform_continuously

ROOT = Path(__file__).parents[2]
MAKEFILE = (ROOT / "Makefile").read_text("utf-8")
CAMERAS = re.search(r"\$\(CAMERAS\)/\.ready:.*?'\.\[([\w,]+)\]'", MAKEFILE, re.DOTALL)[1]
"""The extras of `make install`."""
APP = "mediapipe,mqtt,dashboard"
"""Those of the Home Assistant app."""
ARM = "observer,mqtt,dashboard"
"""The same where mediapipe has no wheel."""
INCLUDES = {"mediapipe": {"observer"}, "all": {"observer", "report", "capture", "mqtt", "dashboard", "phone"}}
ALONE = ("", "observer", "report", "capture", "mqtt", "dashboard", "phone", "testing")
ENVIRONMENTS = (*ALONE, "all", ARM, "mediapipe", APP, CAMERAS)
"""Extras that are installed together; mediapipe, a gigabyte, last."""
LIMIT_S = 240.0
"""For one job, on a machine that is busy with others."""
SCENE = 'scene = "{0}"\n[mesh]\nendpoint = "tcp/127.0.0.1:0"\n'
OBSERVER = '[observers.{0}]\nsource = "{1}"\nview = "{2}"\n'
STUB_BROKER = '[hub.mqtt]\nhost = "127.0.0.1"\nport = 9\n'


@dataclass(frozen=True, slots=True)
class Job:
    """The smallest job of a verb. line: what its output must hold; ended: send SIGTERM then. needs: the extras, which
    commas separate, without which the job ends with one line that names one. status: of the job where it has all."""

    name: str
    words: str
    needs: str = ""
    status: int = 0
    line: str = ""
    ended: bool = False


JOBS = (
    Job("demo", "demo --no-pixels --output demo", "observer", line="written:"),
    Job("init", "init new.toml --no-look", line="wrote new.toml"),
    Job("up", "up room.toml --exit-when-done", line="sofa finished"),
    Job("observe", "observe room.toml sofa", line="source ended"),
    Job("observe film", "observe film.toml sofa", "observer", line="source ended"),
    Job("fuse", "fuse room.toml", line="serving room", ended=True),
    Job("doctor", "doctor room.toml --for 0.5", line="room"),
    Job("doctor --ready", "doctor --ready room.toml --process sofa", status=1, line="not on the mesh"),
    Job("completion", "completion zsh", line="complete -o default"),
    Job("new", "new hub lamp", line="pip install -e"),
    Job("secure", "secure init room.toml --to secured", line="labanmesh secure add"),
    Job("router", "router tcp/127.0.0.1:0", line="listening on", ended=True),
    Job("teach", "teach room.toml wave clap", status=1, line="labanmesh up room.toml"),
    Job("watch", "watch room.toml --for 0.5"),
    Job("capture", "capture room.toml -o new.mcap --for 0.5", "capture", line="new.mcap: 0 messages"),
    Job("replay", "replay day.mcap", "capture", status=1, line="nothing to judge"),
    Job("hub", "hub mqtt broker.toml", "mqtt", line="127.0.0.1", ended=True),
    Job("hub events", "hub events kept.toml", line="history in", ended=True),
    Job("count", "count room.toml byebye --for 0.5 --json"),
    Job("history", "history kept.toml", status=1, line="nothing has been kept yet"),
    Job("notify", "notify kept.toml", line="0 waiting"),
    Job("phone --list", "phone phone.toml --list", line="labanmesh phone SCENE shows a code"),
    Job(
        "phone",
        "phone phone.toml --for 0.5 --listen 127.0.0.1:0 --host localhost",
        "phone",
        1,
        "labanmesh phone --fetch",
    ),
    Job("dashboard", "dashboard room.toml --for 1 --listen 127.0.0.1:0", "dashboard", line="shows scene room"),
    Job("dashboard --teach", "dashboard room.toml --teach --for 1 --listen 127.0.0.1:0", "dashboard", line="/teach"),
    Job("import", "import csv wave.csv -o new.npz", line="1 recording"),
    Job("camera calibrate", "camera calibrate --points points.csv -o calibrated", "observer", line="points"),
    Job("camera look", "camera look film.avi --tracker camshift", "observer", line="newest picture"),
    Job("camera look mediapipe", "camera look film.avi --tracker mediapipe", "mediapipe", line="newest picture"),
    Job(
        "camera record",
        "camera record seen.toml --label wave --subject anna --seconds 0.3 -o mine.npz",
        "observer",
        2,
        "nothing was recorded",
    ),
    Job("camera place", "camera place seen.toml --seconds 0.3", "observer", 2, "labanmesh camera look shows"),
    Job("learn", "learn known.npz --view yaw:30 -o new.model", "observer", line="new.model: stacked"),
    Job("forget", "forget room.toml --all --yes", status=1, line="labanmesh up room.toml"),
    Job("forget model", "forget sofa.model --labels ok -o less.model", "observer", line="less.model"),
    Job("evaluate --paper", "evaluate --paper known.npz", line="Door and Wheel"),
    Job("evaluate", "evaluate known.npz --views yaw:30 --jobs 1", "observer", line="accuracy"),
    Job(
        "evaluate --report",
        "evaluate known.npz --views yaw:30 --jobs 1 --report report",
        "observer,report",
        line="written",
    ),
    Job("score", "score known.npz --label byebye", line="byebye"),
    Job("evaluate --effort", "evaluate --effort effort.npz --views door", line="accuracy"),
)


def extras_of(extras):
    """The names in `extras`, which commas separate, with all that they include."""
    return {name for extra in extras.split(",") for name in {extra, *INCLUDES.get(extra, ())}} - {""}


def write_material(folder):
    """The files that the jobs name, made with the repository's own code."""
    import cv2

    known = perform(people=("1", "2"), movements=("byebye", "stretch", "ok"), trials=2)
    performance = perform_continuously("4", ("byebye",), rest_s=(0.7, 0.9))
    write_archive(folder / "known.npz", known)
    write_archive(folder / "performance.npz", MotionArchive(known.body_parts, (performance,)))
    factors = ("-1_-1_-1_-1", "1_1_1_1")
    levels = [replace(r, trial=factors[n % 2]) for n, r in enumerate(known.recordings)]
    write_archive(folder / "effort.npz", MotionArchive(known.body_parts, tuple(levels)))
    room = SCENE.format("room") + OBSERVER.format("sofa", "performance.npz", "yaw:30") + "speed = 3.0\n"
    film = OBSERVER.format("sofa", "film.avi", "yaw:30") + 'tracker = "camshift"\n'
    scenes = {
        "room": room,
        "broker": room + STUB_BROKER,
        "film": SCENE.format("film") + film,
        "kept": SCENE.format("kept")
        + '[history]\nfile = "kept.db"\n[notify.lamp]\nurl = "http://127.0.0.1:9/"\n'
        + OBSERVER.format("sofa", "performance.npz", "yaw:30"),
        "phone": SCENE.format("phone") + OBSERVER.format("sofa", "phone", "yaw:30"),
        "seen": SCENE.format("seen")
        + "".join(film.replace("yaw:30", "camera.toml").replace("sofa", name) for name in ("sofa", "shelf")),
    }
    for name, text in scenes.items():
        (folder / f"{name}.toml").write_text(text)
    noise = np.random.default_rng(0)
    writer = cv2.VideoWriter(str(folder / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 15, (320, 240))
    for _ in range(15):
        writer.write(noise.integers(0, 255, (240, 320, 3), dtype=np.uint8))
    writer.release()
    matrix = np.array([[-500.0, 0, 320, 1280], [0, -500, 240, 1360], [0, 0, 1, 4]])
    corners = [(x, y, z) for x in (-1, 0, 1) for y in (0, 1, 2) for z in (-0.5, 0.5)]
    pixels = [matrix @ (*corner, 1) for corner in corners]
    rows = [(*corner, u / depth, v / depth) for corner, (u, v, depth) in zip(corners, pixels, strict=True)]
    with (folder / "points.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows([("x", "y", "z", "u", "v"), *rows])
    (table,) = re.findall(r"```csv\n(.*?)```", (ROOT / "docs/reference/motion.md").read_text("utf-8"), re.DOTALL)
    (folder / "wave.csv").write_text(table)
    own = [sys.executable, "-P", "-m", "labanmesh"]
    for words in (
        "learn known.npz --view yaw:30 -o sofa.model",
        "capture room.toml -o day.mcap --for 0",
        "camera calibrate --points points.csv -o .",
    ):
        subprocess.run([*own, *words.split()], cwd=folder, check=True, capture_output=True, timeout=LIMIT_S)
    (folder / "points.toml").rename(folder / "camera.toml")


def build_wheel(folder):
    """The wheel of the working tree, from a copy: setuptools keeps modules that were removed in the tree's build/."""
    tracked = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    copy = folder / "tree"
    for name in filter(None, tracked.split("\0")):
        if (ROOT / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, copy / name)
    pip("wheel", "--no-deps", "--wheel-dir", folder, copy)
    (wheel,) = folder.glob("labanmesh-*.whl")
    return wheel


def pip(*words, python=None):
    """Run pip of the environment of this test, which keeps one cache of packages for all environments."""
    at = [] if python is None else ["--python", str(python)]
    command = [sys.executable, "-m", "pip", *at, words[0], "--quiet", "--disable-pip-version-check", "--no-input"]
    done = subprocess.run([*command, *map(str, words[1:])], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


class Environment:
    """A new environment with the wheel and `extras`, in which `run` does jobs."""

    def __init__(self, folder, wheel, extras):
        self.extras = extras_of(extras)
        self.place = folder / f"env-{extras.replace(',', '-') or 'plain'}"
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", self.place], check=True)
        python = self.place / "bin" / "python"
        pip("install", f"{wheel}[{extras}]" if extras else wheel, python=python)
        if "mediapipe" in self.extras and subprocess.run([python, "-c", "import cv2"], check=False).returncode:
            # As the Makefile does where the system has no libGL.
            show = "from importlib.metadata import version; print(version('opencv-contrib-python'))"
            version = subprocess.run([python, "-c", show], check=True, capture_output=True, text=True).stdout.strip()
            wanted = f"opencv-python-headless=={version}"
            pip("install", "--force-reinstall", "--no-deps", wanted, python=python)

    def remove(self):
        shutil.rmtree(self.place)

    def run(self, words, folder, stop_at=""):
        """Status, stdout and stderr of a command of this environment; SIGTERM after a line that holds `stop_at`."""
        command = [self.place / "bin" / words[0], *words[1:]]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        # The pose model for phones, 40 MB, is not fetched here.
        pipes["env"] = {**os.environ, "LABANMESH_PHONE_FILES": str(folder / "no_pose_model")}
        with subprocess.Popen(command, cwd=folder, **pipes) as process:
            limit = threading.Timer(LIMIT_S, process.kill)
            limit.start()
            lines = {"stdout": [], "stderr": []}

            def read(name):
                for line in getattr(process, name):
                    lines[name].append(line)
                    if stop_at and stop_at in line:
                        process.send_signal(signal.SIGTERM)

            readers = [threading.Thread(target=read, args=(name,)) for name in lines]
            for reader in readers:
                reader.start()
            for reader in readers:
                reader.join()
            status = process.wait()
            limit.cancel()
        return status, "".join(lines["stdout"]), "".join(lines["stderr"])
