"""Cameras: presence, permissions, and test pictures.

Only `--cameras` opens cameras, each in a process of its own. The checks at the end are pure.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

from common.config import Scene
from common.text import without_secrets
from common.tracker_choice import chosen_tracker
from deploy.doctor.findings import Finding, Mark, from_fault, ok, warning
from deploy.doctor.network import connect_to

CameraAccess = Literal["readable", "forbidden", "absent", "unknown"]
DEVICES = Path("/dev")
WEBCAM_NAMES = Path("/sys/class/video4linux")
PORTS = {"rtsp": 554, "rtsps": 322, "http": 80, "https": 443}
TEST_S = 20.0
"""`labanmesh camera look` itself gives a camera 10 s, and then names the cause."""
TEST_FRAMES = 10
ADVICE, ALL_WELL, OWN_ERROR = "-> ", "nothing to do", "labanmesh: "
"""The beginnings of lines that `labanmesh camera look` prints: advice, no advice, an error."""


@dataclass(frozen=True, slots=True)
class Webcam:
    """A camera of this machine. place: /dev/videoN. name: its maker's."""

    place: str
    name: str = ""
    access: CameraAccess = "readable"

    def __str__(self) -> str:
        return f"{self.place} ({self.name})" if self.name else self.place

    @property
    def permission(self) -> str:
        """The command that lets this user read it."""
        return "sudo usermod -aG video $USER, then log in again"


@dataclass(frozen=True, slots=True)
class NetworkCamera:
    """A camera in the network. url: without secrets. fault: why host:port cannot be reached; "" where it can."""

    url: str
    fault: str = ""
    took_s: float = 0.0


@dataclass(frozen=True, slots=True)
class CameraTest:
    """The outcome of `labanmesh camera look`: its advice, or its error."""

    advice: Sequence[str] = ()
    fault: str = ""


@dataclass(frozen=True, slots=True)
class ObserverCamera:
    """One observer's camera, and its test, if one was asked for."""

    observer: str
    camera: Webcam | NetworkCamera
    test: CameraTest | None = None


def webcams(devices: Path = DEVICES, names: Path = WEBCAM_NAMES) -> list[Webcam]:
    """The cameras of this machine, by number, without the second node of a device, which carries metadata."""
    places = sorted(devices.glob("video[0-9]*"), key=lambda place: (len(place.name), place.name))
    return [_webcam(place, names) for place in places if _read(names / place.name / "index") in ("", "0")]


def observer_cameras(scene: Scene, observers: Sequence[str], *, test: bool) -> list[ObserverCamera]:
    """The cameras of the observers, in the scene's order, without observers that have none. test: take pictures."""
    cameras = [ObserverCamera(name, camera) for name in observers for camera in _cameras(scene, name)]
    if not test or not cameras:
        return cameras
    with ThreadPoolExecutor(len(cameras)) as pool:
        tests = [pool.submit(_test, scene, each) if _may_work(each) else None for each in cameras]
        pairs = zip(cameras, tests, strict=True)
        return [replace(each, test=running.result() if running else None) for each, running in pairs]


def _may_work(each: ObserverCamera) -> bool:
    """Whether to test the camera: one that is known to be absent is skipped, because a test would wait for it."""
    camera = each.camera
    return not camera.fault if isinstance(camera, NetworkCamera) else camera.access in ("readable", "unknown")


def _cameras(scene: Scene, observer: str) -> Iterator[Webcam | NetworkCamera]:
    source = scene.observer(observer).source
    if source.isdecimal():
        yield _webcam(DEVICES / f"video{source}", WEBCAM_NAMES)
    elif source.startswith(("/dev/video", "/dev/v4l/")):
        yield _webcam(Path(source), WEBCAM_NAMES)
    elif source.partition("://")[0].lower() in PORTS:
        yield _network_camera(source)


def _webcam(place: Path, names: Path) -> Webcam:
    if not sys.platform.startswith("linux"):
        return Webcam(str(place), access="unknown")
    access: CameraAccess = "absent"
    if place.exists():
        access = "readable" if os.access(place, os.R_OK | os.W_OK) else "forbidden"
    return Webcam(str(place), _read(names / place.name / "name"), access)


def _network_camera(source: str) -> NetworkCamera:
    try:
        parts = urlsplit(source)
        host, port = parts.hostname or "", parts.port or PORTS[parts.scheme.lower()]
    except ValueError:
        return NetworkCamera(without_secrets(source), "not an address; SCHEME://HOST:PORT/PATH is expected")
    attempt = connect_to(host, port)
    return NetworkCamera(without_secrets(source), attempt.fault, attempt.took_s or 0.0)


def _test(scene: Scene, each: ObserverCamera) -> CameraTest:
    section = scene.observer(each.observer)
    tracker = chosen_tracker(section).name
    with tempfile.TemporaryDirectory() as folder:
        options = ["--tracker", tracker, "-o", f"{folder}/look.png", "--frames", str(TEST_FRAMES)]
        for option, file in (("--skin", section.skin), ("--pose-model", section.pose_model)):
            options += [option, str(scene.place(file))] if file else []
        # A camera file states the size that the pictures must have.
        options += ["--view", str(scene.place(section.view))] if section.view.endswith(".toml") else []
        command = [sys.executable, "-P", "-m", "labanmesh", "camera", "look", section.source, *options]
        try:
            done = subprocess.run(  # noqa: S603 - the command line is ours
                command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=TEST_S, check=False
            )
        except subprocess.TimeoutExpired:
            return CameraTest(fault=f"no picture within {TEST_S:g} s")
    advice = [line.removeprefix(ADVICE) for line in done.stdout.splitlines() if line.startswith(ADVICE)]
    last = done.stderr.strip().rpartition("\n")[2].removeprefix(OWN_ERROR)
    return CameraTest(advice, (last or f"look ended with status {done.returncode}") if done.returncode else "")


def _read(place: Path) -> str:
    try:
        return place.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def check_cameras(cameras: Sequence[ObserverCamera], present: Sequence[Webcam], *, certain: bool) -> list[Finding]:
    """The findings on the cameras of observers. present: all webcams of this machine.

    certain: these observers run on this machine; else a missing camera may belong to another one, and is a warning.
    """
    mark: Mark = "error" if certain else "warning"
    used = {each.camera.place for each in cameras if isinstance(each.camera, Webcam)}
    spare = [webcam for webcam in present if webcam.place not in used]
    presence = [_presence(each, mark, present) for each in cameras]
    return [*presence, *_tests(cameras), *map(_spare, spare)]


def _presence(each: ObserverCamera, mark: Mark, present: Sequence[Webcam]) -> Finding:
    camera, name = each.camera, each.observer
    if isinstance(camera, NetworkCamera):
        if not camera.fault:
            return ok(f"{name}: {camera.url} can be reached, {camera.took_s * 1000:.0f} ms")
        to_do = "switch it on, connect it to this network, or correct its address"
        return Finding(mark, f"{name}: {camera.url}: {camera.fault}", to_do)
    if camera.access == "readable":
        return ok(f"{name}: {camera} is there and may be read")
    if camera.access == "forbidden":
        return Finding(mark, f"{name}: {camera.place} may not be read by this user", camera.permission)
    if camera.access == "absent":
        others = ", ".join(webcam.place for webcam in present) or "none"
        to_do = f"plug it in, or correct source; webcams here: {others}"
        return Finding(mark, f"{name}: {camera.place} is not there", to_do)
    return warning(f"{name}: webcams cannot be listed on this system", f"labanmesh camera look {camera.place}")


def _tests(cameras: Sequence[ObserverCamera]) -> Iterator[Finding]:
    for each in cameras:
        if each.test is None:
            continue
        if each.test.fault:
            way_out = "end other programs that use this camera (the observer itself?), then try again"
            yield from_fault("error", f"{each.observer}: {each.test.fault}", way_out)
        for advice in each.test.advice:
            if advice.startswith(ALL_WELL):
                yield ok(f"{each.observer}: test picture: {advice}")
            else:
                what, _, to_do = advice.partition(": ")
                to_do = to_do or "labanmesh camera look shows the picture"
                yield warning(f"{each.observer}: test picture: {what}", to_do)


def _spare(webcam: Webcam) -> Finding:
    if webcam.access == "forbidden":
        return warning(f"{webcam} is there, and may not be read by this user", webcam.permission)
    return ok(f"{webcam} is there, and no observer of this machine uses it")
