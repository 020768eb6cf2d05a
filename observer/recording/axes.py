"""From the room's axes to the performer's: x to his right, y up, z to his back; pure."""

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.tracks import Floats

AXES = {
    sign + name: direction * np.eye(3)[n] for n, name in enumerate("xyz") for sign, direction in (("", 1), ("-", -1))
}
"""x, -x, y, -y, z, -z: unit vectors (3,)."""

UP, FRONT = "y", "-z"
"""The axes of `labanmesh calibrate`: the room's are the performer's."""


def performer_axes(up: str, front: str) -> Floats:
    """(3, 3) rotation from a room in which `up` points up and the performer faces along `front`.

    Its rows are his right, up and back in the room: right = up x back. Raises BadInput for what is no axis, and for two
    on one line.
    """
    for option, axis in (("--up", up), ("--front", front)):
        if axis not in AXES:
            raise BadInput(f"{option} {axis!r}: no axis of the room; known: {', '.join(AXES)}")
    if up[-1] == front[-1]:
        others = ", ".join(axis for axis in AXES if axis[-1] != up[-1])
        raise BadInput(f"--front {front!r}: on the line of --up {up!r}; he faces along one of {others}")
    back = -AXES[front]
    return np.array([np.cross(AXES[up], back), AXES[up], back])


def to_performer_axes(positions: NDArray[np.floating], up: str = UP, front: str = FRONT) -> Floats:
    """(..., 3) metres in the room -> (..., 3) in the performer's axes; raises BadInput as `performer_axes` does."""
    result: Floats = positions @ performer_axes(up, front).T
    return result
