"""Frames and tracks: what sources deliver and where trackers find the body parts in it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput

if TYPE_CHECKING:
    import threading

    from common.teaching_messages import Side

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Integers = NDArray[np.int64]
Picture = NDArray[np.uint8]
"""(H, W, 3) in the order blue, green, red, 0 to 255; row 0 is the top row."""
Size = tuple[int, int]
"""Width and height of a picture in px, the order of `image_size_px` in a camera file."""
Clock = Callable[[], int]
"""Returns nanoseconds: since 1970 for capture times, since any moment for durations."""

BODY_PARTS = ("left_hand", "right_hand", "head")
"""The paper's three: lh, rh and face (section V.A), in the order of every per-part array."""
WHOLE_BODY = (
    *BODY_PARTS,
    *(f"{side}_{part}" for part in ("elbow", "shoulder") for side in ("left", "right")),
    *("neck", "pelvis"),
    *(f"{side}_{part}" for part in ("hip", "knee", "foot") for side in ("left", "right")),
)
"""All parts that pose models find, named and ordered as in the archives of depth cameras."""
LOST_S = 1.0
"""After so long out of sight a person is lost: who is seen then may be somebody else, or do something else."""


def other_side(body_parts: Sequence[str]) -> list[int]:
    """For each part the row of its counterpart, left_hand for right_hand; its own row where there is none."""
    row, other = {part: n for n, part in enumerate(body_parts)}, {"left": "right", "right": "left"}
    sides = [part.partition("_") for part in body_parts]
    return [row.get(f"{other.get(side, side)}_{part}", n) for n, (side, _, part) in enumerate(sides)]


class State(StrEnum):
    """State of one part in one frame; only `seen` is evidence."""

    SEEN = "seen"
    UNSURE = "unsure"
    MISSING = "missing"


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture, one instant of recorded motion, or one frame of tracks from another program.

    captured_ns: Unix epoch, stamped at capture. content: (H, W, 3) uint8 blue, green, red for a picture, (P, 3) metres
    for recorded motion, (P, 2) centres for tracks. motion_ns: time within the motion, from any origin, for recordings
    that are not played at the speed at which they were recorded. last: the recording ends with this frame, and its
    movement too; the next frame, if any, begins another recording, or the same one again. repeated: it is the previous
    frame once more, which slow playback still shows at that time; it contains nothing new. skipped: how many frames the
    source has left out before this one, because newer ones could be delivered when the observer asked.
    """

    captured_ns: int
    content: NDArray[Any]
    motion_ns: int | None = None
    last: bool = False
    repeated: bool = False
    skipped: int = 0

    @property
    def at_ns(self) -> int:
        """Time within the motion; differences do not depend on the speed of playback."""
        return self.captured_ns if self.motion_ns is None else self.motion_ns


def size_of(picture: Picture) -> Size:
    """Width and height in px."""
    return picture.shape[1], picture.shape[0]


def require_picture(content: NDArray[Any], least_px: int = 1) -> Picture:
    """The content if it is a picture of at least `least_px` each way; raises BadInput otherwise."""
    if content.ndim != 3 or content.shape[2] != 3 or content.dtype != np.uint8 or min(content.shape[:2]) < least_px:
        raise BadInput(
            f"picture {content.shape} of {content.dtype}: (H, W, 3) of uint8 in the order blue, green, red is expected,"
            f" at least {least_px} px each way"
        )
    return content


@dataclass(frozen=True, slots=True)
class Outline:
    """An upright rectangle around a person, px of the picture."""

    left: float
    top: float
    right: float
    bottom: float


@dataclass(frozen=True, slots=True)
class SeenPeople:
    """followed: the person whose tracks these are, None while nobody is followed. others: everybody else in sight."""

    followed: Outline | None = None
    others: tuple[Outline, ...] = ()

    @property
    def count(self) -> int:
        """How many people are seen."""
        return len(self.others) + (self.followed is not None)

    @property
    def side(self) -> "Side | None":
        """Where in the picture the followed person is among the others; None without others."""
        if self.followed is None or not self.others:
            return None
        lefts = [other.left + other.right for other in self.others]
        own = self.followed.left + self.followed.right
        return "left" if own < min(lefts) else "right" if own > max(lefts) else "middle"


@dataclass(frozen=True, slots=True)
class PersonTracks:
    """One of several people whom a tracker follows. id: of this person, as long as the tracker is sure who it is.

    centres: (P, 2) as of `Tracks`. every: (Q, 2) all parts that the tracker finds, where a view is known in its pixels.
    u, v, height: the middle of the body and how tall it would stand, px of the picture.
    """

    id: int
    centres: Floats
    u: float
    v: float
    height: float
    every: Floats | None = None


@dataclass(frozen=True, slots=True)
class Tracks:
    """centres: (P, 2) image coordinates, u to the right, v DOWN, any unit; a row of NaN is a part not seen.

    guesses: (P, 2) estimates for parts that the tracker does not see (merged, hidden, doubtful), NaN where it has none.
    A guess is shown to people and is never evidence. people: those in the picture; None if the tracker does not tell.
    persons: of a tracker that follows several people, each; the centres are then those of the first.
    """

    centres: Floats
    guesses: Floats | None = None
    people: SeenPeople | None = None
    persons: tuple[PersonTracks, ...] = ()

    @property
    def visible(self) -> NDArray[np.bool_]:
        """(P,) whether each part is seen."""
        return _known(self.centres)

    @property
    def states(self) -> tuple[State, ...]:
        """P states: seen with a centre, unsure with a guess only, missing with neither."""
        visible = self.visible
        guessed = np.zeros_like(visible) if self.guesses is None else _known(self.guesses)
        return tuple(
            State.SEEN if s else State.UNSURE if g else State.MISSING for s, g in zip(visible, guessed, strict=True)
        )


def _known(rows: Floats) -> NDArray[np.bool_]:
    known: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(rows), axis=1)
    return known


class Tracker(Protocol):
    """Finds the body parts in frames."""

    @property
    def body_parts(self) -> Sequence[str]:
        """Names of the P parts, in the order of the rows of `Tracks.centres`."""

    def update(self, frame: Frame) -> Tracks:
        """The tracks in the newest frame; may use earlier ones."""


class FrameSource(Protocol):
    """Delivers frames, stamped at capture, until it ends or is stopped."""

    @property
    def rate_hz(self) -> float:
        """Frames per second of motion, whatever the speed of playback."""

    @property
    def body_parts(self) -> Sequence[str]:
        """Names of the rows of a frame's content, if the content is positions or tracks."""

    def frames(self, stop: "threading.Event") -> Iterator[Frame]:
        """The frames, each when it is due; ends soon after `stop` is set.

        A source in real time gives an observer that is too slow the newest frame, and counts the others in `skipped`.
        """
