"""Why little or nothing was recorded: what each camera saw, what two of them saw at once, and what helps; pure."""

from collections.abc import Iterator, Sequence

import numpy as np

from common.errors import BadInput
from common.text import plural
from observer.recording.reconstruction import CameraTracks, Reconstruction

NOBODY_SEEN = (
    "no camera saw any part",
    "labanmesh camera look SOURCE shows what a tracker finds. camshift needs a face that looks at the camera, or the "
    'colour of the skin (skin = "skin.npz" in the scene file); tracker = "mediapipe" needs neither',
)
ONE_VIEW = (
    "no part was seen by two cameras at one moment",
    "Stand where at least two cameras see face and hands, nearer or in better light; or set "
    'tracker = "mediapipe" in the scene file',
)
DISAGREE = (
    "the cameras saw the same parts, and no two agree where they are",
    "Calibrate the cameras again, or give their pictures the size that their camera files state; a larger --gate "
    "lets coarse tracks pass",
)


class NothingRecorded(BadInput):
    """No position was found. lines: what each camera saw, for people."""

    def __init__(self, cause: str, lines: Sequence[str]) -> None:
        super().__init__(f"nothing was recorded: {cause}")
        self.lines = tuple(lines)


def cause_of(result: Reconstruction) -> str:
    """Why no part has a position, and what to do, in one line."""
    twice = (result.observed.sum(axis=-1) > 1).any()
    cause, remedy = NOBODY_SEEN if not result.observed.any() else DISAGREE if twice else ONE_VIEW
    return f"{cause}. {remedy}"


def visibility_lines(
    tracks: Sequence[CameraTracks], body_parts: Sequence[str], result: Reconstruction | None = None
) -> Iterator[str]:
    """One line for each camera: in how many of its pictures it saw each part; and how often two did at one moment."""
    for camera in tracks:
        counts = np.isfinite(camera.centres).all(axis=-1).sum(axis=0)
        words = ", ".join(f"{part} in {count}" for part, count in zip(body_parts, counts.tolist(), strict=True))
        pictures = plural(len(camera.at_ns), "picture")
        line = f"{pictures}; saw {words}" if len(camera.at_ns) else "no picture"
        yield f"{camera.name}: {line}{f'; its tracker says: {camera.complaint}' if camera.complaint else ''}"
    if result is not None:
        twice = (result.observed.sum(axis=-1) > 1).sum(axis=0)
        words = ", ".join(f"{part} in {count}" for part, count in zip(body_parts, twice.tolist(), strict=True))
        yield f"two cameras at one moment: {words} of {plural(len(result.observed), 'instant')}"
