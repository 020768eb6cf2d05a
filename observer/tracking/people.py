"""People in a picture: where they are, whose hand is raised, which one is followed, and who is around. Pure.

Distances are in heights of the person, see `Body`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
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


STEP, SPEED = 0.25, 1.5
"""From one picture to the next the hips move by less than STEP, plus SPEED for each second in between: 2.5 m/s."""
GROWTH = 1.6
"""Heights that differ more are not of the same person."""
NEAR, MERGED, HIDDEN, OWN = 1.5, 0.4, 0.6, 0.22
"""Distances from which another person is watched closely; at which two people are taken for one, while the followed one
is seen and while that one is hidden; and at which somebody found is the followed person."""
ALONE_S, COMPANY_S, STIRRED_S, NEAR_S = 3.0, 0.5, 0.2, 0.1
"""Time between two searches for others: with nobody else, with somebody, when something moves beside the followed
person or that person has moved, and with somebody near."""
MOVED_HEIGHTS = 0.4
"""Distance from the place of the last search from which the followed person has moved."""
OTHER_S = 1.5
"""Others who are not found again for so long are gone."""


@dataclass(frozen=True, slots=True)
class OtherPerson:
    """Somebody who is not followed. du, dv: px per second. sightings: how often found."""

    body: Body
    ms: int
    du: float = 0.0
    dv: float = 0.0
    sightings: int = 1

    def at(self, ms: int) -> Body:
        """Where they are at that time if they go on."""
        gone_s = (ms - self.ms) / 1000
        return replace(self.body, u=self.body.u + self.du * gone_s, v=self.body.v + self.dv * gone_s)

    def reach(self, ms: int) -> float:
        """How far from `at` they can be, px."""
        return (STEP + SPEED * (ms - self.ms) / 1000) * self.body.height

    def found(self, body: Body, ms: int) -> "OtherPerson":
        """The same person, found again."""
        gone_s = max(ms - self.ms, 1) / 1000
        du, dv = (body.u - self.body.u) / gone_s, (body.v - self.body.v) / gone_s
        return OtherPerson(body, ms, du, dv, self.sightings + 1)


class Company:
    """The people around the followed person, as far as searches find them."""

    def __init__(self, people: Sequence[OtherPerson] = ()) -> None:
        self.people = list(people)
        self._looked: tuple[int, Body] | None = None

    def is_due(self, followed: Body, stirred: bool, ms: int) -> bool:
        """Whether it is time to look around. stirred: something moves beside the followed person."""
        if self._looked is None:
            return True
        looked_ms, place = self._looked
        stirred = stirred or place.distance(followed) > MOVED_HEIGHTS * followed.height
        near = any(one.at(ms).distance(followed) < NEAR * followed.height for one in self.people)
        pause_s = NEAR_S if near else STIRRED_S if stirred else COMPANY_S if self.people else ALONE_S
        return ms - looked_ms >= 1000 * pause_s

    def update(self, followed: Body, bodies: Sequence[Body], ms: int) -> None:
        """Take in the bodies that a search found; the nearest one is the followed person's, if it is near enough."""
        self._looked = ms, followed
        rest = sorted(distinct(bodies), key=followed.distance)
        if rest and rest[0].distance(followed) < OWN * followed.height:
            rest = rest[1:]
        # What appears too near is a limb of the followed person that is not covered: others were seen as they came.
        strangers = [b for b in self.strangers(rest, ms) if b.distance(followed) >= MERGED * followed.height]
        self.people += [OtherPerson(body, ms) for body in strangers]

    def strangers(self, bodies: Sequence[Body], ms: int) -> list[Body]:
        """The bodies that belong to none of the known others; the others are updated with theirs."""
        known = [one for one in self.people if ms - one.ms <= 1000 * OTHER_S]
        again, strangers = [], []
        for body in bodies:
            same = min(known, key=lambda one: one.at(ms).distance(body), default=None)
            if same is not None and same.at(ms).distance(body) < same.reach(ms):
                known.remove(same)
                again.append(same.found(body, ms))
            else:
                strangers.append(body)
        self.people = again + known
        return strangers

    def is_other(self, body: Body, followed: Body, ms: int) -> bool:
        """Whether one of them is nearer to `body` than the followed person is."""
        return any(one.at(ms).distance(body) < followed.distance(body) for one in self.people)

    def merges_with(self, followed: Body, visible: bool, ms: int) -> bool:
        """Whether one who was found twice is too near and too alike to be told from the followed person.

        visible: whether the followed person is seen now.
        """
        return any(
            one.sightings > 1
            and one.at(ms).distance(followed) < (MERGED if visible else HIDDEN) * followed.height
            and one.body.resembles(followed, GROWTH)
            for one in self.people
        )
