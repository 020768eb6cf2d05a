"""What an observer sees in one frame: where each body part is in its image, if it is seen at all."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import threading

Floats = NDArray[np.float64]

BODY_PARTS = ("left_hand", "right_hand", "head")
"""The paper's three: lh, rh and face (section V.A), in the order of every per-part array."""


class State(StrEnum):
    """What a tracker says of one part in one frame; only `seen` is evidence."""

    SEEN = "seen"
    UNSURE = "unsure"
    MISSING = "missing"


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture, or one instant of recorded motion: `content` is whatever the tracker understands.

    captured_ns: Unix epoch, stamped at capture. content: (P, 3) positions in metres for recorded motion, (H, W, 3)
    uint8 in the order blue, green, red for a picture, (P, 2) centres for the tracks of others. motion_ns: when in the
    motion itself, for what is not played at the speed at which it was recorded; counted from anywhere.
    """

    captured_ns: int
    content: NDArray[Any]
    motion_ns: int | None = None

    @property
    def at_ns(self) -> int:
        """When in the motion: differences are what a body needs to move, however fast a recording is played."""
        return self.captured_ns if self.motion_ns is None else self.motion_ns


@dataclass(frozen=True, slots=True)
class Tracks:
    """centres: (P, 2) image coordinates, u to the right, v DOWN, any unit; a row of NaN is a part not seen.

    guesses: (P, 2) where a tracker thinks that parts are which it does not claim to see (merged, hidden, doubtful);
    a row of NaN where it has none. A guess is shown to people and is never evidence.
    """

    centres: Floats
    guesses: Floats | None = None

    @property
    def visible(self) -> NDArray[np.bool_]:
        """(P,) whether each part is seen."""
        return _known(self.centres)

    @property
    def states(self) -> tuple[State, ...]:
        """P states: seen with a centre, unsure with a guess alone, missing with neither."""
        seen = self.visible
        guessed = np.zeros_like(seen) if self.guesses is None else _known(self.guesses)
        return tuple(
            State.SEEN if s else State.UNSURE if g else State.MISSING for s, g in zip(seen, guessed, strict=True)
        )


def _known(rows: Floats) -> NDArray[np.bool_]:
    known: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(rows), axis=1)
    return known


class Tracker(Protocol):
    """Finds the body parts in a frame."""

    @property
    def body_parts(self) -> Sequence[str]:
        """Names of the P parts, in the order of the rows of `Tracks.centres`."""

    def update(self, frame: Frame) -> Tracks:
        """The tracks in the newest frame; may remember earlier ones."""


class FrameSource(Protocol):
    """Delivers frames, stamped at capture, until it ends or is told to stop."""

    @property
    def rate_hz(self) -> float:
        """Frames per second of motion: at this rate they were sampled, however fast they are played."""

    @property
    def body_parts(self) -> Sequence[str]:
        """Names of what the rows of a frame's content are, if the content is positions."""

    def frames(self, stop: "threading.Event") -> Iterator[Frame]:
        """The frames, each when it is due; ends soon after `stop` is set."""
