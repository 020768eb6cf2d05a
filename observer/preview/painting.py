"""The painted picture: the source's picture with marks, and the panel beside it."""

import cv2
import numpy as np

from observer.camera.base import require_picture, size_of
from observer.preview.drawing import (
    CANVAS,
    LARGE,
    PLAIN,
    SIZE,
    SMALL,
    STATE_COLOUR,
    Colour,
    PaintingLayout,
    PixelBox,
    Placement,
    draw_mark,
    draw_person,
    main_rows,
    width_of,
    wrapped,
    write,
)
from observer.preview.sight import Picture, ShownPosterior, Sighting
from observer.tracks import State

GROUND: Colour = (28, 25, 24)
BRIGHT: Colour = (240, 240, 240)
DIM: Colour = (160, 155, 150)
TRACK: Colour = (58, 53, 50)
BAR: Colour = (150, 120, 95)
WINNER: Colour = STATE_COLOUR[State.SEEN]
REST_COLOUR: Colour = (130, 130, 130)

EDGE = 14
MOST_MOVEMENTS = 8
"""Most movements shown."""
ROW, LINE = 22, 19
"""Heights of a bar and of a line of text, px."""
COMPLAINT_LINES = 3
"""Lines reserved for the complaint, so that the rest keeps its position."""
INSET = (150, 320)
"""Greatest height of the inset, px, with a posterior and without."""
INSET_PX = 320
"""The back-projection is computed for about this many pixels per row, since it is shown small."""


def _draw_panel(canvas: Picture, sighting: Sighting, title: str) -> None:
    """Draw title, legend, complaint, posterior and back-projection, from top to bottom."""
    canvas[:] = GROUND
    width = canvas.shape[1] - 2 * EDGE
    write(canvas, title, (EDGE, 30), BRIGHT, LARGE, width_px=width)
    y = _draw_legend(canvas, sighting, 60)
    for number, line in enumerate(wrapped(sighting.complaint, PLAIN, width, COMPLAINT_LINES)):
        write(canvas, line, (EDGE, y + 6 + number * LINE), STATE_COLOUR[State.UNSURE], PLAIN, width_px=width)
    y += 6 + COMPLAINT_LINES * LINE
    if sighting.posterior is not None:
        y = draw_posterior(canvas, sighting.posterior, y)
    back = back_projection(sighting)
    if back is not None:
        _draw_inset(canvas, back, y, INSET[sighting.posterior is None])


def _draw_legend(canvas: Picture, sighting: Sighting, y: int) -> int:
    states = sighting.tracks.states
    main = main_rows(sighting.body_parts)
    for part, state in ((sighting.body_parts[row], states[row]) for row in main):
        draw_mark(canvas, (EDGE + 9, y), state, 8)
        write(canvas, part.replace("_", " "), (EDGE + 30, y + 5), BRIGHT, PLAIN, width_px=110)
        write(canvas, state.value, (EDGE + 146, y + 5), STATE_COLOUR[state], PLAIN)
        y += 25
    if len(main) < len(states):
        write(canvas, f"{states.count(State.SEEN)} of {len(states)} parts seen", (EDGE + 30, y + 5), DIM, SMALL)
        y += LINE
    return y


def draw_posterior(canvas: Picture, posterior: ShownPosterior, y: int) -> int:
    """Draw a bar per movement, as long as it is probable, and one for rest; returns the y below, px."""
    width = canvas.shape[1] - 2 * EDGE
    write(canvas, f"posterior, entropy {posterior.entropy_bits:.2f} bit", (EDGE, y + 6), BRIGHT, PLAIN, width_px=width)
    y += 14
    for index in posterior.most_probable(MOST_MOVEMENTS):
        won = index == posterior.winner
        _draw_bar(canvas, y, posterior.labels[index], float(posterior.p[index]), WINNER if won else BAR, won)
        y += ROW
    others = len(posterior.labels) - MOST_MOVEMENTS
    if others > 0:
        write(canvas, f"and {others} less probable", (EDGE, y + 14), DIM, SMALL, width_px=width)
        y += LINE
    _draw_bar(canvas, y + 5, "(at rest)", posterior.rest, REST_COLOUR, False)
    return y + ROW + 10


def _draw_bar(canvas: Picture, y: int, label: str, share: float, colour: Colour, won: bool) -> None:
    names, number = canvas.shape[1] * 2 // 5, f"{100 * share:.0f} %"
    room = names - EDGE - 8
    size = PLAIN if width_of(label) <= room else SMALL
    write(canvas, label, (EDGE, y + 16), WINNER if won else DIM, size, width_px=room, bold=won)
    left, right = bar_ends(canvas.shape[1])
    cv2.rectangle(canvas, (left, y + 4), (right - 1, y + ROW - 5), TRACK, -1)
    length = round(min(max(share, 0.0), 1.0) * (right - left))
    if length:
        cv2.rectangle(canvas, (left, y + 4), (left + length - 1, y + ROW - 5), colour, -1)
    write(canvas, number, (canvas.shape[1] - 8 - width_of(number, SMALL), y + 16), BRIGHT if won else DIM, SMALL)


def bar_ends(width_px: int) -> tuple[int, int]:
    """Left and right end of a full bar on a panel of that width, px."""
    return width_px * 2 // 5, width_px - 58


def back_projection(sighting: Sighting) -> Picture | None:
    """(h, w) uint8 where the picture has the colour of the person's skin, reduced; None if that is not known."""
    if sighting.skin is None or sighting.picture is None:
        return None
    step = max(1, sighting.picture.shape[1] // INSET_PX)
    small: Picture = sighting.skin.back_project(sighting.picture[::step, ::step].copy())
    return small


def _draw_inset(canvas: Picture, back: Picture, y: int, most: int) -> None:
    """Draw the back-projection (H, W) uint8 at the bottom, in the room below `y`; white is skin colour."""
    height, width = canvas.shape[:2]
    room_height, room_width = min(most, height - y - 34), width - 2 * EDGE
    scale = min(room_width / back.shape[1], room_height / back.shape[0])
    wide, high = round(back.shape[1] * scale), round(back.shape[0] * scale)
    if min(wide, high) < 1:
        return
    top = height - 10 - high
    write(canvas, "skin colour (back-projection)", (EDGE, top - 8), DIM, SMALL, width_px=room_width)
    small = cv2.resize(back, (wide, high), interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    canvas[top : top + high, EDGE : EDGE + wide] = small[..., None]
    cv2.rectangle(canvas, (EDGE - 1, top - 1), (EDGE + wide, top + high), TRACK, 1)


SURROUND_GREY = 14
"""Grey level around the picture."""
CAPTION = (150, 150, 150)
SHEET, GRID = 46, 58
"""Grey levels of the empty sheet for recorded motion."""


def paint(sighting: Sighting, title: str) -> Picture:
    """(720, 1280, 3) BGR; the sighting's picture is not changed. Raises BadInput for another shape or type of it."""
    picture = sighting.picture
    layout = PaintingLayout.of(*CANVAS) if picture is None else PaintingLayout.of(*size_of(require_picture(picture)))
    canvas = np.full((SIZE[1], SIZE[0], 3), SURROUND_GREY, np.uint8)
    area = layout.picture.cut(canvas)
    if picture is None:
        area[:] = _empty_sheet(layout.picture)
        placement = Placement.of_motion(sighting.extent, layout.picture)
    else:
        area[:] = _resized(picture, layout.picture)
        placement = Placement.of_picture(picture.shape[1], layout.picture)
    draw_person(area, placement, sighting, named=True)
    _draw_panel(layout.panel.cut(canvas), sighting, title)
    return canvas


def _empty_sheet(box: PixelBox) -> Picture:
    """A dark sheet with a grid, (height, width, 3) of the box, for motion without a picture."""
    sheet = np.full((box.height, box.width, 3), SHEET, np.uint8)
    side = max(box.height // 12, 1)
    sheet[::side] = GRID
    sheet[:, ::side] = GRID
    write(sheet, "recorded motion, no picture", (12, box.height - 12), CAPTION, SMALL, width_px=box.width - 24)
    return sheet


def _resized(picture: Picture, box: PixelBox) -> Picture:
    method = cv2.INTER_AREA if box.width < picture.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, (box.width, box.height), interpolation=method), dtype=np.uint8)
