"""People in a picture: where they are, whose hand is raised, and which of them an observer follows. Pure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.tracks import Floats, Outline

Follow = Literal["largest", "nearest", "raised_hand"]
Rgb = NDArray[np.uint8]
"""A picture, (H, W, 3) red, green, blue."""

NOSE, SHOULDERS, WRISTS, HIPS = 0, (11, 12), (15, 16), (23, 24)
"""Landmarks of BlazePose, left and right."""
REGION = 1.25
"""Side of the square that the pose model looks at, of a person's height: as in MediaPipe's own graph."""
CLEARLY_SEEN = 0.5
"""Visibility from which a landmark counts."""
GRID_PX = 8
"""Motion is looked for in cells of so many pixels each way."""
GREY_LEVEL = 120
ON_MARK = 0.4
"""Share of the height from which a person stands on the marked place."""
WIDE = 0.4
"""Width of the frame that is drawn around a person, of the height; arms may leave it."""


@dataclass(frozen=True, slots=True)
class Body:
    """Where a person is. u, v: the middle between the hips, px. height: diameter of the circle about the hips that
    would hold the body if it stood upright, px; it hardly depends on the pose. turn: of the body, clockwise, rad."""

    u: float
    v: float
    height: float
    turn: float = 0.0

    def distance(self, other: "Body") -> float:
        """Px between the two middles."""
        return math.hypot(self.u - other.u, self.v - other.v)

    def resembles(self, other: "Body", ratio: float) -> bool:
        """Whether neither is more than `ratio` times as tall as the other."""
        return 1 / ratio <= self.height / other.height <= ratio

    @property
    def outline(self) -> Outline:
        """A frame around the standing person."""
        half, wide = self.height / 2, self.height * WIDE / 2
        return Outline(self.u - wide, self.v - half, self.u + wide, self.v + half)


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """landmarks: (33, 3) u and v as shares of the picture, visibility 0 to 1. body: where they say the person is."""

    landmarks: Floats
    body: Body

    @property
    def hand_is_raised(self) -> bool:
        """Whether a wrist is seen above the nose."""
        wrists = self.landmarks[list(WRISTS)]
        above = (wrists[:, 1] < self.landmarks[NOSE, 1]) & (wrists[:, 2] >= CLEARLY_SEEN)
        return bool(above.any())


@dataclass(frozen=True, slots=True)
class SearchArea:
    """A rectangle of the picture in which people are searched, px."""

    left: int
    top: int
    width: int
    height: int

    def cut(self, rgb: Rgb) -> Rgb:
        """This part of the picture, contiguous."""
        part = rgb[self.top : self.top + self.height, self.left : self.left + self.width]
        return np.ascontiguousarray(part)

    def covered(self, rgb: Rgb) -> Rgb:
        """A copy of the picture in which this part is grey."""
        copy = rgb.copy()
        copy[self.top : self.top + self.height, self.left : self.left + self.width] = GREY_LEVEL
        return copy

    def holds(self, u: float, v: float) -> bool:
        """Whether a place of the picture, px, lies in it."""
        return self.left <= u <= self.left + self.width and self.top <= v <= self.top + self.height

    def of_grid(self, grid: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The part of a grid of cells of GRID_PX that lies in it."""
        bottom, right = self.top + self.height, self.left + self.width
        return grid[self.top // GRID_PX : bottom // GRID_PX, self.left // GRID_PX : right // GRID_PX]


def area_about(body: Body, wide: float, size: tuple[int, int], high: float | None = None) -> SearchArea | None:
    """The part of a picture of size (width, height) about a person, px; None if nothing of it is in the picture."""
    high = wide if high is None else high
    left, top = max(int(body.u - wide / 2), 0), max(int(body.v - high / 2), 0)
    right, bottom = min(int(body.u + wide / 2) + 1, size[0]), min(int(body.v + high / 2) + 1, size[1])
    return SearchArea(left, top, right - left, bottom - top) if min(right - left, bottom - top) > 1 else None


class PersonModel(Protocol):
    """A pose model that can be told where to look. Places are px of the whole picture."""

    def find(self, rgb: Rgb, area: SearchArea, ms: int) -> Sequence[Body]:
        """The people in a part of the picture, the surest first. ms: as in `PoseModel.landmarks`."""

    def pose(self, rgb: Rgb, body: Body, ms: int) -> Pose | None:
        """The landmarks of the person who is about there; None if nobody is. Smoothed since the last `restart`."""

    def restart(self) -> None:
        """The next pose is that of another person, or of one at another place."""

    def close(self) -> None:
        """Release the threads of the model; no picture may follow."""


@dataclass(frozen=True, slots=True)
class FollowRule:
    """Who is followed when nobody is: the scene keys `follow` and `follow_near`.

    near: the marked place for "nearest", shares of width and height. Raises BadInput without it, and with it for
    another rule.
    """

    name: Follow = "largest"
    near: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if (self.name == "nearest") != (self.near is not None):
            raise BadInput('follow = "nearest" and follow_near = [u, v] belong together: give both or neither')

    def ordered(self, bodies: Sequence[Body], size: tuple[int, int]) -> list[Body]:
        """The candidates, first choice first. size: width and height of the picture, px."""
        if self.near is None:
            return sorted(bodies, key=lambda body: -body.height)
        mark = Body(self.near[0] * size[0], self.near[1] * size[1], 1.0)
        return sorted(bodies, key=mark.distance)

    def is_met_by(self, bodies: Sequence[Body], size: tuple[int, int]) -> bool:
        """Whether no further candidate can be a better choice: a hand may be raised, or one stands on the mark."""
        if self.near is None:
            return self.name == "raised_hand"
        mark = Body(self.near[0] * size[0], self.near[1] * size[1], 1.0)
        return any(mark.distance(body) < ON_MARK * body.height for body in bodies)

    def __str__(self) -> str:
        near = "" if self.near is None else f" to {self.near[0]:g}, {self.near[1]:g}"
        return self.name.replace("_", " ") + near


def distinct(bodies: Sequence[Body], share: float = 0.3) -> list[Body]:
    """The bodies without those that another one before them stands for: nearer than `share` of its height."""
    result: list[Body] = []
    for body in bodies:
        if all(body.distance(one) > share * max(one.height, body.height) for one in result):
            result.append(body)
    return result
