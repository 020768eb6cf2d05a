"""What is to be said of cameras: are they there, may this user read them, does a look at them show anything. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from deploy.doctor.finding import Finding, Mark, ok, told, warning

GROUP: Final = "cameras"
Access = Literal["readable", "forbidden", "absent", "unknown"]
ALL_WELL = "nothing to do"


@dataclass(frozen=True, slots=True)
class Webcam:
    """A camera of this machine. place: /dev/videoN. name: its maker's. group: of the users who may read it."""

    place: str
    name: str = ""
    access: Access = "readable"
    group: str = "video"


@dataclass(frozen=True, slots=True)
class Address:
    """A camera in the network. shown: without secrets. fault: why host:port cannot be reached; "" where it can."""

    shown: str
    fault: str = ""
    took_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Looked:
    """What `labanmesh look` said: its advice, or its error."""

    advice: Sequence[str] = ()
    fault: str = ""


@dataclass(frozen=True, slots=True)
class Eye:
    """One observer's camera, and how a look at it went, if one was asked for."""

    observer: str
    camera: Webcam | Address
    looked: Looked | None = None


def findings(eyes: Sequence[Eye], present: Sequence[Webcam], *, certain: bool) -> list[Finding]:
    """All that is to be said of the cameras of these observers. present: all webcams of this machine.

    certain: these observers run on this machine; else what is missing may be meant for another one.
    """
    mark: Mark = "error" if certain else "warning"
    used = {eye.camera.place for eye in eyes if isinstance(eye.camera, Webcam)}
    spare = [webcam for webcam in present if webcam.place not in used]
    found = [finding for eye in eyes for finding in _eye(eye, mark, present)]
    return [*found, *_looks(eyes), *_spare(spare)]


def _eye(eye: Eye, mark: Mark, present: Sequence[Webcam]) -> Iterator[Finding]:
    camera = eye.camera
    if isinstance(camera, Address):
        if camera.fault:
            what = f"{eye.observer}: {camera.shown}: {camera.fault}"
            yield Finding(GROUP, mark, what, "see that it is on, in this network, and the address right")
        else:
            yield ok(GROUP, f"{eye.observer}: {camera.shown} can be reached, {camera.took_s * 1000:.0f} ms")
    elif camera.access == "readable":
        yield ok(GROUP, f"{eye.observer}: {_named(camera)} is there and may be read")
    elif camera.access == "forbidden":
        to_do = f"sudo usermod -aG {camera.group} $USER, then log in again"
        yield Finding(GROUP, mark, f"{eye.observer}: {camera.place} may not be read by this user", to_do)
    elif camera.access == "absent":
        there = ", ".join(webcam.place for webcam in present) or "none"
        to_do = f"plug it in, or correct source; webcams here: {there}"
        yield Finding(GROUP, mark, f"{eye.observer}: {camera.place} is not there", to_do)
    else:
        to_do = f"labanmesh look {camera.place}"
        yield warning(GROUP, f"{eye.observer}: webcams cannot be listed on this system", to_do)


def _looks(eyes: Sequence[Eye]) -> Iterator[Finding]:
    for eye in eyes:
        if eye.looked is None:
            continue
        if eye.looked.fault:
            way_out = "end what else uses this camera (the observer itself?), then look again"
            yield told(GROUP, "error", f"{eye.observer}: {eye.looked.fault}", way_out)
        for advice in eye.looked.advice:
            if advice.startswith(ALL_WELL):
                yield ok(GROUP, f"{eye.observer}: looked at: {advice}")
            else:
                what, _, to_do = advice.partition(": ")
                yield warning(GROUP, f"{eye.observer}: looked at: {what}", to_do or "labanmesh look shows the picture")


def _spare(spare: Sequence[Webcam]) -> Iterator[Finding]:
    for webcam in spare:
        if webcam.access == "forbidden":
            to_do = f"sudo usermod -aG {webcam.group} $USER, then log in again"
            yield warning(GROUP, f"{_named(webcam)} is there, and may not be read by this user", to_do)
        else:
            yield ok(GROUP, f"{_named(webcam)} is there, and no observer of this machine uses it")


def _named(webcam: Webcam) -> str:
    return f"{webcam.place} ({webcam.name})" if webcam.name else webcam.place


def nothing_to_see() -> Finding:
    """Where neither a scene nor this machine has a camera."""
    return warning(GROUP, "no webcam on this machine", "plug one in, or name an address or a recording as source")
