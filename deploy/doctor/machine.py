"""This machine: Python and its packages, clock, disk, memory. The functions after `machine_needs` are pure."""

import ctypes
import platform
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from common.config import Scene
from common.tracker_choice import INSTALL_MEDIAPIPE, PICTURE_TRACKERS, chosen_tracker
from deploy.doctor.findings import Finding, Mark, error, ok, warning

ClockState = Literal["synchronised", "free", "unknown"]
MIB = 1 << 20
GIB = 1 << 30
LITTLE_DISK = 500 * MIB
"""Bytes; clips of verdicts and a capture of four observers take far less in a day."""
LITTLE_MEMORY = 300 * MIB
"""Bytes; an observer takes 100 to 150 MB, one with mediapipe twice that."""
INSTALL_OBSERVER = "pip install 'labanmesh[observer]'"
OPENCV = ("opencv-python-headless", "opencv-python", "opencv-contrib-python", "opencv-contrib-python-headless")
CASCADE = "haarcascade_frontalface_alt2.xml"
"""The one that trackers and `labanmesh camera look` use."""
UNSYNCHRONISED_US = 16_000_000
"""With this maximum error the kernel's clock counts as unsynchronised; timedatectl uses the same limit."""


@dataclass(frozen=True, slots=True)
class MachineFacts:
    """The facts of this machine. A version is "" where there is none. packages: those of the plain install.

    free_*: None where it cannot be told. face_cascade: whether the installed OpenCV has one.
    folder: the one whose disk was measured.
    """

    system: str
    python: str
    labanmesh: str
    packages: Mapping[str, str]
    opencv: str
    mediapipe: str
    face_cascade: bool
    clock: ClockState
    free_disk: int | None
    free_memory: int | None
    folder: str


@dataclass(frozen=True, slots=True)
class MachineNeeds:
    """Which observers, by id, need OpenCV, its face cascade, mediapipe, the model that it may bring.

    other_clocks: whether the scene is on several machines; None where no scene is known.
    """

    opencv: tuple[str, ...] = ()
    cascade: tuple[str, ...] = ()
    mediapipe: tuple[str, ...] = ()
    carried_model: tuple[str, ...] = ()
    other_clocks: bool | None = None


def machine_facts(folder: Path) -> MachineFacts:
    """This machine's facts; the free disk space is that of `folder`'s disk."""
    lines = (installed_version("labanmesh") and requires("labanmesh")) or []
    plain = [re.split(r"[^\w.-]", line)[0] for line in lines if "extra ==" not in line]
    return MachineFacts(
        system=f"{platform.system()} {platform.machine()}",
        python=platform.python_version(),
        labanmesh=installed_version("labanmesh") or "(not installed)",
        packages={name: installed_version(name) for name in plain},
        opencv=next(filter(None, map(installed_version, OPENCV)), ""),
        mediapipe=installed_version("mediapipe"),
        face_cascade=_has_cascade(),
        clock=clock_state(),
        free_disk=_free_disk(folder),
        free_memory=_free_memory(),
        folder=str(folder),
    )


def installed_version(name: str) -> str:
    """The version of an installed distribution, or ""."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def clock_state() -> ClockState:
    """Whether this machine's clock is synchronised, as the kernel says."""
    # struct timex begins with modes, offset, freq and maxerror, a word each; it has less than 64 words.
    timex = (ctypes.c_long * 64)()
    try:
        result = ctypes.CDLL(None, use_errno=True).adjtimex(timex)
    except (AttributeError, OSError):
        result = -1
    if result >= 0:
        return "synchronised" if timex[3] < UNSYNCHRONISED_US else "free"
    return "unknown"


def _has_cascade() -> bool:
    module = find_spec("cv2")
    return bool(module and module.origin and (Path(module.origin).parent / "data" / CASCADE).exists())


def _free_disk(folder: Path) -> int | None:
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return None


def _free_memory() -> int | None:
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError):
        return None
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")), None)


def machine_needs(scene: Scene, observers: Sequence[str]) -> MachineNeeds:
    """The needs of these observers of a scene."""
    sections = {name: scene.observer(name) for name in observers}
    trackers = {name: chosen_tracker(section).name for name, section in sections.items()}
    pictures = [name for name, tracker in trackers.items() if tracker in PICTURE_TRACKERS]
    pose = [name for name in pictures if trackers[name] == "mediapipe"]
    colour = [name for name in pictures if trackers[name] == "camshift"]
    untaught = [name for name in colour if not (sections[name].skin or sections[name].face)]
    carried = [name for name in pose if not sections[name].pose_model]
    clocks = scene.mesh.mode == "router"
    return MachineNeeds(tuple(pictures), tuple(untaught), tuple(pose), tuple(carried), clocks)


def check_machine(facts: MachineFacts, needs: MachineNeeds, *, certain: bool = True) -> list[Finding]:
    """The findings on this machine, for observers with such needs.

    certain: they run on this machine; else they may be meant for another, and a missing package is no error.
    """
    lacking: Mark = "error" if certain else "warning"
    versions = {"labanmesh": facts.labanmesh, "Python": facts.python, **facts.packages}
    present = ", ".join(f"{name} {installed}" for name, installed in versions.items() if installed)
    missing = (f"{name} is not installed" for name, installed in facts.packages.items() if not installed)
    return [
        ok(f"{present}; {facts.system}"),
        *(error(what, "pip install labanmesh") for what in missing),
        *_opencv(facts, needs, lacking),
        *_mediapipe(facts.mediapipe, needs, lacking),
        _clock(facts.clock, needs.other_clocks),
        *_free_space(facts),
    ]


def _opencv(facts: MachineFacts, needs: MachineNeeds, lacking: Mark) -> Iterator[Finding]:
    if not facts.opencv:
        if needs.opencv:
            what = f"OpenCV is not installed; needed by {', '.join(needs.opencv)}"
            yield Finding(lacking, what, INSTALL_OBSERVER)
        else:
            yield ok("OpenCV is not installed, and not needed here")
        return
    if facts.face_cascade or not needs.cascade:
        yield ok(f"OpenCV {facts.opencv}{', with a face cascade' * facts.face_cascade}")
    if needs.cascade and not facts.face_cascade:
        observers = ", ".join(needs.cascade)
        what = f"OpenCV {facts.opencv} has no face cascade; camshift of {observers} learns skin colour with it"
        to_do = "pip install 'opencv-python-headless>=4.11,<5', or name a saved histogram (skin) in the scene file"
        yield Finding(lacking, what, to_do)


def _mediapipe(installed: str, needs: MachineNeeds, lacking: Mark) -> Iterator[Finding]:
    if not needs.mediapipe:
        return
    if not installed:
        what = f"mediapipe is not installed; needed by {', '.join(needs.mediapipe)}"
        yield Finding(lacking, what, INSTALL_MEDIAPIPE)
    else:
        yield ok(f"mediapipe {installed}")
    if installed and needs.carried_model and not installed.startswith("0.10.21"):
        what = f"mediapipe {installed} brings no pose model; needed by {', '.join(needs.carried_model)}"
        yield Finding(lacking, what, "name a pose landmarker .task file as pose_model in the scene file")


def _clock(clock: ClockState, other_clocks: bool | None) -> Finding:
    if clock == "synchronised":
        return ok("the clock is synchronised")
    if other_clocks is False:
        return ok("the clock may be wrong, and does no harm: all processes of this scene share it")
    mark: Mark = "warning" if other_clocks else "hint"
    if clock == "unknown":
        what = "cannot tell whether the clock is synchronised"
        return Finding(mark, what, "check that NTP runs (chronyc tracking, timedatectl)")
    what = "the clock is not synchronised: on several machines posteriors would seem younger or older than they are"
    return Finding(mark, what, "timedatectl set-ntp true, or install chrony")


def _free_space(facts: MachineFacts) -> Iterator[Finding]:
    for place, free, little, way_out in (
        (f"on the disk of {facts.folder}", facts.free_disk, LITTLE_DISK, "make room"),
        ("in memory", facts.free_memory, LITTLE_MEMORY, "end other programs, or run fewer observers here"),
    ):
        if free is not None:
            what = f"{_size(free)} free {place}"
            yield ok(what) if free >= little else warning(what, way_out)


def _size(size: int) -> str:
    return f"{size / GIB:.1f} GiB" if size >= GIB else f"{size / MIB:.0f} MiB"
