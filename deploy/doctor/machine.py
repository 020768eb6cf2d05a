"""The findings on this machine: Python and its packages, clock, disk, memory. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from deploy.doctor.findings import Finding, Mark, error, ok, warning

if TYPE_CHECKING:
    from common.config import ObserverConfig, Scene

GROUP: Final = "this machine"
ClockState = Literal["synchronised", "free", "unknown"]
MIB = 1 << 20
GIB = 1 << 30
LITTLE_DISK = 500 * MIB
"""Bytes; a preview film takes about 1 MB a second, a capture of four observers far less."""
LITTLE_MEMORY = 300 * MIB
"""Bytes; an observer takes 100 to 150 MB, one with mediapipe twice that."""
WITHOUT_PICTURES = ("zenoh:", "-")
"""How sources begin that deliver tracks."""
INSTALL_OBSERVER = "pip install 'labanmesh[observer]'"


@dataclass(frozen=True, slots=True)
class Package:
    """A distribution that may be installed. version: "" where it is not. fits: the version is within `bounds`."""

    name: str
    version: str
    bounds: str = ""
    fits: bool = True

    @property
    def misfit(self) -> str:
        """That its version is not one that labanmesh is tested with."""
        return f"{self.name} {self.version}: labanmesh is tested with {self.bounds}"


@dataclass(frozen=True, slots=True)
class MachineFacts:
    """The facts of this machine. packages: those of the plain install. free_*: None where it cannot be told.

    face_cascade: whether the installed OpenCV has one. folder: the one whose disk was measured.
    """

    system: str
    python: str
    labanmesh: str
    packages: Sequence[Package]
    opencv: Package
    mediapipe: Package
    face_cascade: bool
    clock: ClockState
    free_disk: int | None
    free_memory: int | None
    folder: str


@dataclass(frozen=True, slots=True)
class MachineNeeds:
    """Which observers, by id, need OpenCV, its face cascade, mediapipe, and the model that mediapipe may bring."""

    opencv: tuple[str, ...] = ()
    cascade: tuple[str, ...] = ()
    mediapipe: tuple[str, ...] = ()
    carried_model: tuple[str, ...] = ()


def machine_needs(scene: "Scene", observers: Sequence[str]) -> MachineNeeds:
    """The needs of these observers of a scene."""
    sections = {name: scene.observer(name) for name in observers}
    pictures = {name: section for name, section in sections.items() if _sees_pictures(section)}
    pose = {name: section for name, section in pictures.items() if section.tracker == "mediapipe"}
    untaught = [s for s in pictures if s not in pose and not (sections[s].skin or sections[s].face)]
    return MachineNeeds(tuple(pictures), tuple(untaught), tuple(pose), tuple(s for s in pose if not pose[s].pose_model))


def check_machine(facts: MachineFacts, needs: MachineNeeds, *, certain: bool = True) -> list[Finding]:
    """The findings on this machine, for observers with such needs.

    certain: they run on this machine; else they may be meant for another, and a missing package is no error.
    """
    lacking: Mark = "error" if certain else "warning"
    return [
        ok(GROUP, f"labanmesh {facts.labanmesh}, Python {facts.python}, {facts.system}"),
        *_packages(facts.packages),
        *_opencv(facts, needs, lacking),
        *_mediapipe(facts.mediapipe, needs, lacking),
        _clock(facts.clock),
        *_free_space(facts),
    ]


def _sees_pictures(section: "ObserverConfig") -> bool:
    if section.tracker == "auto":
        return not section.source.endswith(".npz") and not section.source.startswith(WITHOUT_PICTURES)
    return section.tracker in ("camshift", "mediapipe")


def _packages(packages: Sequence[Package]) -> Iterator[Finding]:
    good = [f"{package.name} {package.version}" for package in packages if package.version and package.fits]
    if good:
        yield ok(GROUP, ", ".join(good))
    for package in packages:
        install = f"pip install '{package.name}{package.bounds}'"
        if not package.version:
            yield error(GROUP, f"{package.name} is not installed", install)
        elif not package.fits:
            yield error(GROUP, package.misfit, install)


def _opencv(facts: MachineFacts, needs: MachineNeeds, lacking: Mark) -> Iterator[Finding]:
    package = facts.opencv
    if not package.version:
        if needs.opencv:
            what = f"OpenCV is not installed; needed by {', '.join(needs.opencv)}"
            yield Finding(GROUP, lacking, what, INSTALL_OBSERVER)
        else:
            yield ok(GROUP, "OpenCV is not installed, and not needed here")
        return
    if not package.fits:
        yield warning(GROUP, package.misfit, INSTALL_OBSERVER)
    elif facts.face_cascade or not needs.cascade:
        yield ok(GROUP, f"OpenCV {package.version}{', with a face cascade' * facts.face_cascade}")
    if needs.cascade and not facts.face_cascade:
        observers = ", ".join(needs.cascade)
        what = f"OpenCV {package.version} has no face cascade; camshift of {observers} learns skin colour with it"
        to_do = "pip install 'opencv-python-headless>=4.11,<5', or name a saved histogram (skin) in the scene file"
        yield Finding(GROUP, lacking, what, to_do)


def _mediapipe(package: Package, needs: MachineNeeds, lacking: Mark) -> Iterator[Finding]:
    if not needs.mediapipe:
        return
    install = "pip install 'labanmesh[mediapipe]'"
    if not package.version:
        what = f"mediapipe is not installed; needed by {', '.join(needs.mediapipe)}"
        yield Finding(GROUP, lacking, what, install)
    elif not package.fits:
        yield warning(GROUP, package.misfit, install)
    else:
        yield ok(GROUP, f"mediapipe {package.version}")
    if package.version and needs.carried_model and not package.version.startswith("0.10.21"):
        what = f"mediapipe {package.version} brings no pose model; needed by {', '.join(needs.carried_model)}"
        yield Finding(GROUP, lacking, what, "name a pose landmarker .task file as pose_model in the scene file")


def _clock(clock: ClockState) -> Finding:
    if clock == "synchronised":
        return ok(GROUP, "the clock is synchronised")
    if clock == "free":
        what = "the clock is not synchronised: on several machines posteriors would seem younger or older than they are"
        return warning(GROUP, what, "timedatectl set-ntp true, or install chrony")
    what = "cannot tell whether the clock is synchronised"
    return warning(GROUP, what, "check that NTP runs (chronyc tracking, timedatectl)")


def _free_space(facts: MachineFacts) -> Iterator[Finding]:
    for place, free, little, way_out in (
        (f"on the disk of {facts.folder}", facts.free_disk, LITTLE_DISK, "make room"),
        ("in memory", facts.free_memory, LITTLE_MEMORY, "end other programs, or run fewer observers here"),
    ):
        if free is not None:
            what = f"{_size(free)} free {place}"
            yield ok(GROUP, what) if free >= little else warning(GROUP, what, way_out)


def _size(size: int) -> str:
    return f"{size / GIB:.1f} GiB" if size >= GIB else f"{size / MIB:.0f} MiB"
