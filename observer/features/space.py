"""Laban's Space: the motion of each body part between two frames as a Vector Symbol (section III.A, (1))."""

import math
from collections import deque
from collections.abc import Sequence
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.tracks import Floats, Tracks

Symbols = NDArray[np.int8]


class VectorSymbol(IntEnum):
    """The nine values of B in the order of (1), clockwise from up: R is image right, U is image up.

    NOT_SEEN is none of the nine: the motion is unknown, so that all nine are equally likely. O is seen to be
    still.
    """

    NOT_SEEN = -1
    O = 0  # noqa: E741 - the paper's letter
    U = 1
    UR = 2
    R = 3
    DR = 4
    D = 5
    DL = 6
    L = 7
    UL = 8


def vector_symbols(displacements: Floats, size: float, threshold: float) -> Symbols:
    """(..., 2) displacements in the image, v down -> (...) int8 symbols (section III.A).

    Bins of 45° centred on the axes. Displacements shorter than threshold * size are O; size: the body's, in the
    displacements' unit. NOT_SEEN where a displacement is NaN, and everywhere while the size is NaN (not known yet).
    """
    finite: NDArray[np.bool_] = np.isfinite(displacements)
    known = np.logical_and.reduce(finite, axis=-1, keepdims=True) & math.isfinite(size)
    du, dv = np.moveaxis(np.where(known, displacements, 0.0), -1, 0)
    length = np.hypot(du, dv)
    # Without the second condition a threshold of 0 would give stillness a direction.
    still = (length < threshold * size) | (length == 0)
    eighths_from_up = np.rint(np.arctan2(du, -dv) / (math.pi / 4)) % 8
    moved = np.where(still, VectorSymbol.O, VectorSymbol.U + eighths_from_up)
    return np.where(known[..., 0], moved, VectorSymbol.NOT_SEEN).astype(np.int8)


class BodySize:
    """The performer's size in the image, estimated from past frames.

    torso_share: the size is this share of the largest distance so far between the head and a visible hand. With a
    hanging arm that distance is about the one from head to hip plus a hand; 0.45 of it is about a torso.
    """

    def __init__(self, torso_share: float = 0.45) -> None:
        self._torso_share = torso_share
        self._largest = 0.0

    def update(self, centres: Floats, body_parts: Sequence[str]) -> float:
        """(P, 2) centres (NaN: not seen) and the names of the P parts -> size in the same unit; NaN until known.

        Raises BadInput if there is no head or no hand among the names.
        """
        head, hands = _head_and_hands(body_parts)
        distances = np.linalg.norm(centres[hands] - centres[head], axis=1)
        self._largest = max(self._largest, float(np.nanmax(distances, initial=0.0)))
        return self._torso_share * self._largest if self._largest > 0 else math.nan


class SpaceReader:
    """Reads Space from a stream of tracks: one Vector Symbol per body part and frame.

    body_parts: names of the P parts. threshold: shortest motion that counts as one, as a share of the performer's
    size; it depends on the frame rate and is fitted on training subjects. over: the number of frames between the two
    that are compared, 1 as in the paper; at a camera's rate neighbouring frames hardly differ.
    """

    def __init__(self, body_parts: Sequence[str], threshold: float, over: int = 1) -> None:
        self._body_parts = tuple(body_parts)
        self._threshold = threshold
        self._size = BodySize()
        self._last: deque[Floats] = deque(maxlen=over)

    def update(self, tracks: Tracks) -> Symbols:
        """(P,) symbols of the motion since `over` frames ago; NOT_SEEN for a part that was missing now or then.

        All are NOT_SEEN in the first `over` frames, and until a hand was seen together with the head.
        """
        size = self._size.update(tracks.centres, self._body_parts)
        known = len(self._last) == self._last.maxlen
        displacements = tracks.centres - (self._last[0] if known else np.nan)
        self._last.append(tracks.centres.copy())
        return vector_symbols(displacements, size, self._threshold)


def _head_and_hands(body_parts: Sequence[str]) -> tuple[int, list[int]]:
    hands = [row for row, part in enumerate(body_parts) if part in ("left_hand", "right_hand")]
    if "head" not in body_parts or not hands:
        raise BadInput(f"body_parts = {list(body_parts)}: the size needs a head and a left_hand or right_hand")
    return body_parts.index("head"), hands
