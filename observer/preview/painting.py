"""The painted picture: the source's picture with marks, the panel beside it and the strip of Vector Symbols below."""

import math

import cv2
import numpy as np

from observer.camera.base import require_picture, size_of
from observer.features import VectorSymbol
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
    draw_marks,
    main_rows,
    width_of,
    wrapped,
    write,
)
from observer.preview.sight import SYMBOL_FRAMES, Picture, PreviewFrame, ShownPosterior
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


def draw_panel(canvas: Picture, shown: PreviewFrame) -> None:
    """Draw title, legend, complaint, posterior and back-projection, from top to bottom."""
    canvas[:] = GROUND
    width = canvas.shape[1] - 2 * EDGE
    write(canvas, shown.title, (EDGE, 30), BRIGHT, LARGE, width_px=width)
    age = "" if shown.age_s is None else f", {1000 * shown.age_s:.0f} ms old"
    write(canvas, f"frame {shown.frame}{age}", (EDGE, 52), DIM, SMALL, width_px=width)
    y = _draw_legend(canvas, shown, 78)
    for number, line in enumerate(wrapped(shown.complaint, PLAIN, width, COMPLAINT_LINES)):
        write(canvas, line, (EDGE, y + 6 + number * LINE), STATE_COLOUR[State.UNSURE], PLAIN, width_px=width)
    y += 6 + COMPLAINT_LINES * LINE
    if shown.posterior is not None:
        y = draw_posterior(canvas, shown.posterior, y)
    if shown.back_projection is not None:
        draw_inset(canvas, shown.back_projection, y, INSET[shown.posterior is None])


def _draw_legend(canvas: Picture, shown: PreviewFrame, y: int) -> int:
    states = shown.tracks.states
    main = main_rows(shown.body_parts)
    for part, state in ((shown.body_parts[row], states[row]) for row in main):
        draw_mark(canvas, (EDGE + 9, y), state, 8)
        name = part.replace("_", " ")
        write(canvas, name, (EDGE + 30, y + 5), BRIGHT, PLAIN, width_px=110)
        write(canvas, state.value, (EDGE + 146, y + 5), STATE_COLOUR[state], PLAIN)
        y += 25
    if len(main) < len(states):
        others = f"{states.count(State.SEEN)} of {len(states)} parts seen"
        write(canvas, others, (EDGE + 30, y + 5), DIM, SMALL)
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


def draw_inset(canvas: Picture, back: Picture, y: int, most: int) -> None:
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


STRIP_GROUND: Colour = (38, 34, 32)
STRIP_LINE: Colour = (70, 64, 60)
NAME_COLOUR: Colour = (225, 225, 225)
STILL_DOT: Colour = (125, 120, 115)
ARROW: Colour = (255, 255, 255)
NAMES_PX = 112
"""Width of the column with the names, px."""


def draw_strip(canvas: Picture, shown: PreviewFrame) -> None:
    """Draw an arrow for each motion (up is up in the picture), a dot for stillness, a gap for a part not seen."""
    height, width = canvas.shape[:2]
    canvas[:] = STRIP_GROUND
    main = main_rows(shown.body_parts)
    row_height = (height - 16) / len(main)
    step = (width - NAMES_PX - 12) / SYMBOL_FRAMES
    write(canvas, "motion, newest right; dot: still, gap: not seen", (NAMES_PX, height - 4), STILL_DOT, SMALL)
    for place, row in enumerate(main):
        part, middle = shown.body_parts[row], 4 + round((place + 0.5) * row_height)
        write(canvas, part.replace("_", " "), (12, middle + 5), NAME_COLOUR, PLAIN, width_px=NAMES_PX - 18)
        for back, symbol in enumerate(reversed(shown.symbols[-SYMBOL_FRAMES:, row].tolist())):
            right = width - 12 - round(back * step)
            if symbol != VectorSymbol.NOT_SEEN:
                cv2.line(canvas, (right - round(step), middle), (right, middle), STRIP_LINE, 1)
            draw_symbol(canvas, (right - round(step / 2), middle), VectorSymbol(symbol), 0.38 * min(step, row_height))


def draw_symbol(canvas: Picture, at: tuple[int, int], symbol: VectorSymbol, half: float) -> None:
    """Draw one symbol about `at`; `half`: half the length of an arrow, px. NOT_SEEN leaves a gap."""
    if symbol is VectorSymbol.O:
        cv2.circle(canvas, at, 2, STILL_DOT, -1, cv2.LINE_AA)
    elif symbol is not VectorSymbol.NOT_SEEN:
        turn = (symbol - VectorSymbol.U) * math.pi / 4
        du, dv = round(half * math.sin(turn)), round(-half * math.cos(turn))
        begin, end = (at[0] - du, at[1] - dv), (at[0] + du, at[1] + dv)
        cv2.arrowedLine(canvas, begin, end, ARROW, 2, cv2.LINE_AA, tipLength=0.45)


SURROUND_GREY = 14
"""Grey level around the picture."""
CAPTION = (150, 150, 150)
SHEET, GRID = 46, 58
"""Grey levels of the empty sheet for recorded motion."""


def paint(picture: Picture | None, shown: PreviewFrame) -> Picture:
    """(H, W, 3) BGR, or None for recorded motion -> (720, 1280, 3) BGR; the picture is not changed.

    Raises BadInput for another shape or type.
    """
    layout = PaintingLayout.of(*CANVAS) if picture is None else PaintingLayout.of(*size_of(require_picture(picture)))
    canvas = np.full((SIZE[1], SIZE[0], 3), SURROUND_GREY, np.uint8)
    area = layout.picture.cut(canvas)
    if picture is None:
        area[:] = empty_sheet(layout.picture)
        placement = Placement.of_motion(shown.extent, layout.picture)
    else:
        area[:] = _resized(picture, layout.picture)
        placement = Placement.of_picture(picture.shape[1], layout.picture)
    draw_marks(area, placement, shown)
    draw_panel(layout.panel.cut(canvas), shown)
    draw_strip(layout.strip.cut(canvas), shown)
    return canvas


def empty_sheet(box: PixelBox) -> Picture:
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
