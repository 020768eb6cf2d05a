"""The facts of this machine: versions, clock, disk, memory. Where the kernel does not tell, timedatectl is asked."""

import ctypes
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path

from deploy.doctor.machine import ClockState, MachineFacts, Package

OPENCV = ("opencv-python-headless", "opencv-python", "opencv-contrib-python", "opencv-contrib-python-headless")
CASCADE = "haarcascade_frontalface_alt2.xml"
"""The one that trackers and `labanmesh look` use."""
UNSYNCHRONISED_US = 16_000_000
"""With this maximum error the kernel's clock counts as unsynchronised; timedatectl uses the same limit."""
TOOL_S = 1.0
REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)(\[[^]]*\])?\s*(?P<bounds>[^;]*?)\s*(;\s*(?P<marker>.*))?\Z")
BOUND = re.compile(r"(<=|>=|==|!=|<|>)\s*([\d.]+)")
EXTRA = re.compile(r"""extra\s*==\s*["']([\w-]+)["']""")
PYTHON = re.compile(r"""python_version\s*(<=|>=|==|!=|<|>)\s*["']([\d.]+)["']""")


@dataclass(frozen=True, slots=True)
class Requirement:
    """One distribution that labanmesh requires, within `bounds` ("<2,>=1.6"); extra: "" for the plain install."""

    name: str
    bounds: str
    extra: str = ""


class _Timex(ctypes.Structure):
    """The beginning of the kernel's struct timex; the rest is only room for it."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        *((name, ctypes.c_long) for name in ("offset", "freq", "maxerror", "esterror")),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_char * 512),
    )


def machine_facts(folder: Path) -> MachineFacts:
    """This machine's facts; the free disk space is that of `folder`'s disk."""
    required = list(requirements(_metadata(), f"{sys.version_info.major}.{sys.version_info.minor}"))
    return MachineFacts(
        system=f"{platform.system()} {platform.machine()}",
        python=platform.python_version(),
        labanmesh=installed_version("labanmesh") or "(not installed)",
        packages=tuple(_package(each) for each in required if not each.extra),
        opencv=_opencv(required),
        mediapipe=_package(_requirement("mediapipe", required)),
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
    """Whether this machine's clock is synchronised, as the kernel says, else timedatectl."""
    state = _Timex()
    try:
        result = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(state))
    except (AttributeError, OSError):
        result = -1
    if result >= 0:
        return "synchronised" if state.maxerror < UNSYNCHRONISED_US else "free"
    return _by_timedatectl()


def requirements(lines: Iterable[str], python: str) -> Iterator[Requirement]:
    """The requirements in a distribution's metadata for this `python` ("3.11"), labanmesh itself left out."""
    for line in lines:
        match = REQUIREMENT.match(line.strip())
        if match is None or match["name"] == "labanmesh":
            continue
        marker = match["marker"] or ""
        extra = EXTRA.search(marker)
        if all(_holds(python, *bound) for bound in PYTHON.findall(marker)):
            yield Requirement(match["name"], match["bounds"], extra[1] if extra else "")


def fits(installed: str, bounds: str) -> bool:
    """Whether the numbers of a version are within `bounds`; a suffix of it (rc1, +local) does not count."""
    return all(_holds(installed, *bound) for bound in BOUND.findall(bounds))


def _holds(installed: str, relation: str, limit: str) -> bool:
    here, there = _numbers(installed), _numbers(limit)
    longest = max(len(here), len(there))
    a, b = (numbers + (0,) * (longest - len(numbers)) for numbers in (here, there))
    return {"<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b, "==": a == b, "!=": a != b}[relation]


def _numbers(text: str) -> tuple[int, ...]:
    match = re.match(r"\d+(\.\d+)*", text)
    return tuple(int(part) for part in match[0].split(".")) if match else ()


def _by_timedatectl() -> ClockState:
    command = ["timedatectl", "show", "-p", "NTPSynchronized", "--value"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TOOL_S, check=False)  # noqa: S603
    except (OSError, subprocess.TimeoutExpired):
        return "unknown"
    states: dict[str, ClockState] = {"yes": "synchronised", "no": "free"}
    return states.get(done.stdout.strip(), "unknown")


def _metadata() -> list[str]:
    try:
        return requires("labanmesh") or []
    except PackageNotFoundError:
        return []


def _requirement(name: str, required: Sequence[Requirement]) -> Requirement:
    return next((each for each in required if each.name == name), Requirement(name, ""))


def _package(requirement: Requirement) -> Package:
    installed = installed_version(requirement.name)
    fitting = fits(installed, requirement.bounds) if installed else True
    return Package(requirement.name, installed, requirement.bounds, fitting)


def _opencv(required: Sequence[Requirement]) -> Package:
    """OpenCV by whichever of its names it is installed, held against the bounds of the one that we require."""
    bounds = _requirement(OPENCV[0], required).bounds
    installed = next(filter(None, map(installed_version, OPENCV)), "")
    return Package("OpenCV", installed, bounds, fits(installed, bounds) if installed else True)


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
