"""Looks which cameras there are and who may read them; opens none, but for `--cameras`, and then in a process."""

import grp
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

from common.config import Scene
from deploy.doctor.cameras import Access, Address, Eye, Looked, Webcam
from deploy.doctor.look_network import reach
from deploy.doctor.origin import masked

DEVICES = Path("/dev")
NAMES = Path("/sys/class/video4linux")
PORTS = {"rtsp": 554, "rtsps": 322, "http": 80, "https": 443}
LOOK_S = 20.0
"""`labanmesh look` itself gives a camera 10 s, and then says more than that it took too long."""
LOOK_FRAMES = 10
ADVICE = "-> "
OWN_ERROR = "labanmesh: "


def webcams(devices: Path = DEVICES, names: Path = NAMES) -> list[Webcam]:
    """The cameras of this machine in the order of their numbers; a device's second node, for metadata, left out."""
    places = sorted(devices.glob("video[0-9]*"), key=lambda place: (len(place.name), place.name))
    return [_webcam(place, names) for place in places if _read(names / place.name / "index") in ("", "0")]


def eyes(scene: Scene, observers: Sequence[str], *, look: bool) -> list[Eye]:
    """The cameras of the named observers, those that have one, in the scene's order; `look`: open them too."""
    found = [eye for name in observers for eye in _eye(scene, name)]
    if not look or not found:
        return found
    with ThreadPoolExecutor(len(found)) as looking:
        looks = [looking.submit(_looked, scene, eye) if _may_be_opened(eye) else None for eye in found]
        return [replace(eye, looked=each.result() if each else None) for eye, each in zip(found, looks, strict=True)]


def _may_be_opened(eye: Eye) -> bool:
    """What is known to be away is not waited for."""
    camera = eye.camera
    return not camera.fault if isinstance(camera, Address) else camera.access in ("readable", "unknown")


def _eye(scene: Scene, observer: str) -> Iterator[Eye]:
    source = scene.observer(observer).source
    if source.isdecimal():
        yield Eye(observer, _named_webcam(DEVICES / f"video{source}"))
    elif source.startswith(("/dev/video", "/dev/v4l/")):
        yield Eye(observer, _named_webcam(Path(source)))
    elif source.partition("://")[0].lower() in PORTS:
        yield Eye(observer, _address(source))


def _named_webcam(place: Path) -> Webcam:
    if not sys.platform.startswith("linux"):
        return Webcam(str(place), access="unknown")
    return _webcam(place, NAMES)


def _webcam(place: Path, names: Path) -> Webcam:
    access: Access = "absent"
    if place.exists():
        access = "readable" if os.access(place, os.R_OK | os.W_OK) else "forbidden"
    return Webcam(str(place), _read(names / place.name / "name"), access, _group(place))


def _group(place: Path) -> str:
    try:
        name = grp.getgrgid(place.stat().st_gid).gr_name
    except (OSError, KeyError):
        return "video"
    return name if name != "root" else "video"


def _address(source: str) -> Address:
    try:
        parts = urlsplit(source)
        host, port = parts.hostname or "", parts.port or PORTS[parts.scheme.lower()]
    except ValueError:
        return Address(masked(source), "no address: SCHEME://HOST:PORT/PATH is expected")
    reached = reach(host, port)
    return Address(masked(source), reached.fault, reached.took_s or 0.0)


def _looked(scene: Scene, eye: Eye) -> Looked:
    """Runs `labanmesh look` on an observer's camera, as the scene file has it."""
    section = scene.observer(eye.observer)
    tracker = "camshift" if section.tracker == "auto" else section.tracker
    with tempfile.TemporaryDirectory() as folder:
        options = ["--tracker", tracker, "-o", f"{folder}/look.png", "--frames", str(LOOK_FRAMES)]
        skin = ["--skin", str(scene.place(section.skin))] if section.skin else []
        command = [sys.executable, "-P", "-m", "labanmesh", "look", section.source, *options, *skin]
        try:
            done = subprocess.run(  # noqa: S603 - the command line is ours
                command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=LOOK_S, check=False
            )
        except subprocess.TimeoutExpired:
            return Looked(fault=f"no picture within {LOOK_S:g} s")
    advice = [line.removeprefix(ADVICE) for line in done.stdout.splitlines() if line.startswith(ADVICE)]
    last = done.stderr.strip().rpartition("\n")[2].removeprefix(OWN_ERROR)
    return Looked(advice, (last or f"look ended with status {done.returncode}") if done.returncode else "")


def _read(place: Path) -> str:
    try:
        return place.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
