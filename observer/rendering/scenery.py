"""What a rendered picture shows besides the performer, and how badly: background, noise, light, occlusion, blur."""

import math
from dataclasses import dataclass

from common.errors import BadInput

BACKGROUNDS = ("plain", "cluttered", "skin_toned")
"""A bare wall; shelves and boxes of many colours, none like skin; beige wall and wood, near the hue of skin."""


@dataclass(frozen=True, slots=True)
class Occluder:
    """A box before the performer, in frames first..end-1. left, top, width, height: shares of the picture, 0 to 1."""

    left: float
    top: float
    width: float
    height: float
    first: int = 0
    end: int = 2**62

    def covers(self, frame_number: int) -> bool:
        """Whether the box is there in that frame."""
        return self.first <= frame_number < self.end


@dataclass(frozen=True, slots=True)
class Scenery:
    """Everything but the performer; by default a plain wall seen by a perfect camera in steady light.

    noise: standard deviation of every pixel and channel, grey levels, 0 to 64. slow_light: by which share the
    brightness swings, once in `slow_frames`. sudden_light: by which share it may jump up or down, with a shift of
    its colour, every `sudden_frames`. blur: which share of the time from frame to frame the shutter is open.
    Raises BadInput for an unknown background and for a number out of range (shares are 0 to 1).
    """

    background: str = "plain"
    noise: float = 0.0
    slow_light: float = 0.0
    slow_frames: int = 150
    sudden_light: float = 0.0
    sudden_frames: int = 45
    blur: float = 0.0
    occluders: tuple[Occluder, ...] = ()

    def __post_init__(self) -> None:
        if self.background not in BACKGROUNDS:
            raise BadInput(f"background = {self.background!r}: unknown background; known: {', '.join(BACKGROUNDS)}")
        _check_range("noise", self.noise, 64.0)
        for name in ("slow_light", "sudden_light", "blur"):
            _check_range(name, getattr(self, name), 1.0)
        for name in ("slow_frames", "sudden_frames"):
            if getattr(self, name) < 1:
                raise BadInput(f"{name} = {getattr(self, name)}: at least one frame is expected")
        for occluder in self.occluders:
            for name in ("left", "top", "width", "height"):
                _check_range(f"occluder's {name}", getattr(occluder, name), 1.0)


def _check_range(name: str, value: float, most: float) -> None:
    if not (math.isfinite(value) and 0.0 <= value <= most):
        raise BadInput(f"{name} = {value}: 0 to {most:g} is expected")
