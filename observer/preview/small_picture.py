"""A small picture with marks and states drawn into it, as a JPEG of bounded size: for the live picture and clips."""

import cv2
import numpy as np

from observer.preview.drawing import (
    SMALL,
    STATE_COLOUR,
    PixelBox,
    Placement,
    draw_person,
    fitting,
    width_of,
    write,
)
from observer.preview.sight import Picture, Sighting
from observer.tracks import State

QUALITIES = (75, 60, 45, 30, 20)
"""JPEG qualities, tried in this order until a picture is small enough."""
SMALLER_SCALE = 0.7
"""Scale of a picture that is too large even at the lowest quality."""
LINE_PX = 15
"""Height of a line of text, px."""
ALL_STATES = 4
"""With more parts than this, only those that are not seen are listed."""
SHEET_GREY = 46
"""Grey level of the sheet for motion without a picture."""


def small_picture(sighting: Sighting, side_px: int) -> Picture:
    """(h, w, 3) BGR whose longer side is at most `side_px`, with marks, skeleton and the state of each part."""
    if sighting.picture is None:
        canvas: Picture = np.full((side_px * 3 // 4, side_px, 3), SHEET_GREY, np.uint8)
        placement = Placement.of_motion(sighting.extent, PixelBox(0, 0, side_px, side_px * 3 // 4))
    else:
        canvas = _reduced(sighting.picture, side_px)
        placement = Placement.of_picture(sighting.picture.shape[1], PixelBox(0, 0, canvas.shape[1], canvas.shape[0]))
    draw_person(canvas, placement, sighting, named=False)
    _write_states(canvas, sighting)
    return canvas


def encode_jpeg(picture: Picture, limit_bytes: int) -> tuple[bytes, tuple[int, int]]:
    """The picture as a JPEG of at most `limit_bytes`, coarser or smaller if need be, and its width and height."""
    while True:
        for quality in QUALITIES:
            jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
            if len(jpeg) <= limit_bytes or max(picture.shape[:2]) < 32:
                return jpeg, (picture.shape[1], picture.shape[0])
        picture = _reduced(picture, round(SMALLER_SCALE * max(picture.shape[:2])))


def _reduced(picture: Picture, side_px: int) -> Picture:
    """A copy that may be drawn on, never larger than the picture."""
    scale = min(1.0, side_px / max(picture.shape[:2]))
    size = max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale))
    small = picture.copy() if scale == 1.0 else cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def _write_states(canvas: Picture, sighting: Sighting) -> None:
    """The state of each part in the corner; of a whole body how many are seen, and the others by name."""
    pairs = list(zip(sighting.body_parts, sighting.tracks.states, strict=True))
    if len(pairs) > ALL_STATES:
        unseen = [pair for pair in pairs if pair[1] is not State.SEEN]
        first = (f"{len(pairs) - len(unseen)} of {len(pairs)} parts seen", State.SEEN)
        lines = [first, *((f"{part.replace('_', ' ')} {state}", state) for part, state in unseen[:ALL_STATES])]
    else:
        lines = [(f"{part.replace('_', ' ')} {state}", state) for part, state in pairs]
    for number, (text, state) in enumerate(lines, 1):
        short = fitting(text, SMALL, canvas.shape[1] - 8)
        cv2.rectangle(
            canvas, (0, (number - 1) * LINE_PX), (width_of(short, SMALL) + 8, number * LINE_PX), (0, 0, 0), -1
        )
        write(canvas, short, (4, number * LINE_PX - 4), STATE_COLOUR[state], SMALL)
