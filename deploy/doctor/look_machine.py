"""Looks at this machine: versions, clock, disk, memory. Where the kernel does not tell, timedatectl is asked."""

import ctypes
import platform
import shutil
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path

from deploy.doctor.bounds import Requirement, fits, requirements
from deploy.doctor.machine import Clock, Machine, Package

OPENCV = ("opencv-python-headless", "opencv-python", "opencv-contrib-python", "opencv-contrib-python-headless")
CASCADE = "haarcascade_frontalface_alt2.xml"
"""The one that trackers and `labanmesh look` use."""
UNSYNCHRONISED_US = 16_000_000
"""The kernel's maximum error from which on nobody keeps its clock; what timedatectl goes by too."""
TOOL_S = 1.0


class _Timex(ctypes.Structure):
    """The beginning of the kernel's struct timex; the rest is only room for it."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        *((name, ctypes.c_long) for name in ("offset", "freq", "maxerror", "esterror")),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_char * 512),
    )


def look_at_machine(folder: Path) -> Machine:
    """This machine's facts; `folder`: whose disk counts."""
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    wanted = list(requirements(_metadata(), python))
    return Machine(
        system=f"{platform.system()} {platform.machine()}",
        python=platform.python_version(),
        labanmesh=installed("labanmesh") or "(not installed)",
        packages=tuple(_package(requirement) for requirement in wanted if not requirement.extra),
        opencv=_opencv(wanted),
        mediapipe=_named("mediapipe", wanted),
        face_cascade=_has_cascade(),
        clock=clock(),
        free_disk=_free_disk(folder),
        free_memory=_free_memory(),
        folder=str(folder),
    )


def installed(name: str) -> str:
    """The version of an installed distribution, or ""."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def clock() -> Clock:
    """Whether somebody keeps this machine's clock: the kernel's word, else timedatectl's."""
    state = _Timex()
    try:
        asked = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(state))
    except (AttributeError, OSError):
        asked = -1
    if asked >= 0:
        return "synchronised" if state.maxerror < UNSYNCHRONISED_US else "free"
    return _by_timedatectl()


def _by_timedatectl() -> Clock:
    command = ["timedatectl", "show", "-p", "NTPSynchronized", "--value"]
    try:
        said = subprocess.run(command, capture_output=True, text=True, timeout=TOOL_S, check=False)  # noqa: S603
    except (OSError, subprocess.TimeoutExpired):
        return "unknown"
    answers: dict[str, Clock] = {"yes": "synchronised", "no": "free"}
    return answers.get(said.stdout.strip(), "unknown")


def _metadata() -> list[str]:
    try:
        return requires("labanmesh") or []
    except PackageNotFoundError:
        return []


def _package(requirement: Requirement) -> Package:
    found = installed(requirement.name)
    return Package(requirement.name, found, requirement.bounds, fits(found, requirement.bounds) if found else True)


def _named(name: str, wanted: list[Requirement]) -> Package:
    return next((_package(each) for each in wanted if each.name == name), Package(name, installed(name)))


def _opencv(wanted: list[Requirement]) -> Package:
    """OpenCV by whichever of its names it is installed, held against the bounds of the one that we ask for."""
    asked = _named(OPENCV[0], wanted)
    found = next(filter(None, map(installed, OPENCV)), "")
    return Package("OpenCV", found, asked.bounds, fits(found, asked.bounds) if found else True)


def _has_cascade() -> bool:
    found = find_spec("cv2")
    return bool(found and found.origin and (Path(found.origin).parent / "data" / CASCADE).exists())


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
