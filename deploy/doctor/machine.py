"""What this machine's facts mean: Python and its packages, clock, disk, memory. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from deploy.doctor.finding import Finding, Mark, error, ok, warning

if TYPE_CHECKING:
    from common.config import ObserverConfig, Scene

Clock = Literal["synchronised", "free", "unknown"]
MIB = 1 << 20
GIB = 1 << 30
LITTLE_DISK = 500 * MIB
"""Bytes; a film of a preview takes about 1 MB a second, a capture of four observers far less."""
LITTLE_MEMORY = 300 * MIB
"""Bytes; an observer takes 100 to 150 MB, one with mediapipe twice that."""
FOREIGN_SOURCES = ("zenoh:", "-")


@dataclass(frozen=True, slots=True)
class Package:
    """A distribution that may be installed. version: "" where it is not. fits: the version is within `bounds`."""

    name: str
    version: str
    bounds: str = ""
    fits: bool = True


@dataclass(frozen=True, slots=True)
class Machine:
    """What was seen of this machine. packages: those of the plain install. free_*: None where it cannot be told.

    face_cascade: whether the installed OpenCV has one. folder: whose disk was looked at.
    """

    system: str
    python: str
    labanmesh: str
    packages: Sequence[Package]
    opencv: Package
    mediapipe: Package
    face_cascade: bool
    clock: Clock
    free_disk: int | None
    free_memory: int | None
    folder: str


@dataclass(frozen=True, slots=True)
class Needs:
    """Which observers, by id, need OpenCV, its face cascade, mediapipe, and the model that mediapipe may carry."""

    opencv: tuple[str, ...] = ()
    cascade: tuple[str, ...] = ()
    mediapipe: tuple[str, ...] = ()
    carried_model: tuple[str, ...] = ()


def needs(scene: "Scene", observers: Sequence[str]) -> Needs:
    """What the named observers of a scene need of the machine that they run on."""
    sections = {name: scene.observer(name) for name in observers}
    pictures = {name: section for name, section in sections.items() if _sees_pictures(section)}
    pose = {name: section for name, section in pictures.items() if section.tracker == "mediapipe"}
    shown = [s for s in pictures if s not in pose and not (sections[s].skin or sections[s].face)]
    return Needs(tuple(pictures), tuple(shown), tuple(pose), tuple(s for s in pose if not pose[s].pose_model))


def findings(machine: Machine, needs: Needs, *, certain: bool = True) -> list[Finding]:
    """All that is to be said of this machine, for observers with such needs.

    certain: they run on this machine; else what they need may be meant for another, and lacking it is no error.
    """
    lacking: Mark = "error" if certain else "warning"
    return [
        ok("this machine", f"labanmesh {machine.labanmesh}, Python {machine.python}, {machine.system}"),
        *_packages(machine.packages),
        *_opencv(machine, needs, lacking),
        *_mediapipe(machine.mediapipe, needs, lacking),
        _clock(machine.clock),
        *_room(machine),
    ]


def _sees_pictures(section: "ObserverConfig") -> bool:
    if section.tracker == "auto":
        return not section.source.endswith(".npz") and not section.source.startswith(FOREIGN_SOURCES)
    return section.tracker in ("camshift", "mediapipe")


def _packages(packages: Sequence[Package]) -> Iterator[Finding]:
    good = [f"{package.name} {package.version}" for package in packages if package.version and package.fits]
    if good:
        yield ok("this machine", ", ".join(good))
    for package in packages:
        if not package.version:
            yield error("this machine", f"{package.name} is not installed", _install(package))
        elif not package.fits:
            what = f"{package.name} {package.version}: labanmesh was tried with {package.bounds}"
            yield error("this machine", what, _install(package))


def _install(package: Package) -> str:
    return f"pip install '{package.name}{package.bounds}'"


def _opencv(machine: Machine, needs: Needs, lacking: Mark) -> Iterator[Finding]:
    package, who = machine.opencv, ", ".join(needs.opencv)
    if not package.version:
        if needs.opencv:
            yield Finding(
                "this machine",
                lacking,
                f"OpenCV is not installed; needed by {who}",
                "pip install 'labanmesh[observer]'",
            )
        else:
            yield ok("this machine", "OpenCV is not installed, and not needed here")
        return
    if not package.fits:
        what = f"OpenCV {package.version}: labanmesh was tried with {package.bounds}"
        yield warning("this machine", what, "pip install 'labanmesh[observer]'")
    elif machine.face_cascade or not needs.cascade:
        yield ok("this machine", f"OpenCV {package.version}{', with a face cascade' * machine.face_cascade}")
    if needs.cascade and not machine.face_cascade:
        what = (
            f"OpenCV {package.version} has no face cascade; camshift of {', '.join(needs.cascade)} learns skin from it"
        )
        to_do = "pip install 'opencv-python-headless>=4.11,<5', or name a saved histogram (skin) in the scene file"
        yield Finding("this machine", lacking, what, to_do)


def _mediapipe(package: Package, needs: Needs, lacking: Mark) -> Iterator[Finding]:
    who = ", ".join(needs.mediapipe)
    if not needs.mediapipe:
        return
    if not package.version:
        yield Finding(
            "this machine",
            lacking,
            f"mediapipe is not installed; needed by {who}",
            "pip install 'labanmesh[mediapipe]'",
        )
    elif not package.fits:
        what = f"mediapipe {package.version}: labanmesh was tried with {package.bounds}"
        yield warning("this machine", what, "pip install 'labanmesh[mediapipe]'")
    else:
        yield ok("this machine", f"mediapipe {package.version}")
    if package.version and needs.carried_model and not package.version.startswith("0.10.21"):
        what = f"mediapipe {package.version} carries no pose model; needed by {', '.join(needs.carried_model)}"
        yield Finding(
            "this machine", lacking, what, "name a pose landmarker .task file as pose_model in the scene file"
        )


def _clock(clock: Clock) -> Finding:
    if clock == "synchronised":
        return ok("this machine", "the clock is synchronised")
    if clock == "free":
        what = "the clock is not synchronised: on several machines opinions would seem younger or older than they are"
        return warning("this machine", what, "timedatectl set-ntp true, or install chrony")
    what = "whether the clock is synchronised cannot be told here"
    return warning("this machine", what, "look yourself that NTP runs (chronyc tracking, timedatectl)")


def _room(machine: Machine) -> Iterator[Finding]:
    for what, free, little, way_out in (
        (f"on the disk of {machine.folder}", machine.free_disk, LITTLE_DISK, "make room"),
        ("in memory", machine.free_memory, LITTLE_MEMORY, "end other programs, or run fewer observers here"),
    ):
        if free is not None:
            said = f"{_size(free)} free {what}"
            yield ok("this machine", said) if free >= little else warning("this machine", said, way_out)


def _size(size: int) -> str:
    return f"{size / GIB:.1f} GiB" if size >= GIB else f"{size / MIB:.0f} MiB"
