"""The panel beside the picture: who looks, the state of each part, what is wrong, the belief, and the skin colour."""

import cv2

from observer.preview.lettering import LARGE, PLAIN, SMALL, Colour, width_of, wrapped, write
from observer.preview.marks import COLOURS, draw_mark
from observer.preview.sight import Belief, Picture, Sight
from observer.tracks import State

GROUND: Colour = (28, 25, 24)
BRIGHT: Colour = (240, 240, 240)
DIM: Colour = (160, 155, 150)
TRACK: Colour = (58, 53, 50)
BAR: Colour = (150, 120, 95)
WINNER: Colour = COLOURS[State.SEEN]
REST: Colour = (130, 130, 130)

EDGE = 14
MOVEMENTS = 8
"""So many movements are shown at most."""
ROW, LINE = 22, 19
"""Heights of a bar and of a line of text, px."""
COMPLAINT = 3
"""Lines kept free for what is wrong, so that nothing below jumps."""
INSET = (150, 320)
"""Greatest height of the inset, px, beside a belief and without one."""


def draw_panel(canvas: Picture, sight: Sight) -> None:
    """Everything, from the top to the bottom."""
    canvas[:] = GROUND
    width = canvas.shape[1] - 2 * EDGE
    write(canvas, sight.title, (EDGE, 30), BRIGHT, LARGE, width_px=width)
    age = "" if sight.age_s is None else f", {1000 * sight.age_s:.0f} ms old"
    write(canvas, f"frame {sight.frame}{age}", (EDGE, 52), DIM, SMALL, width_px=width)
    y = _draw_legend(canvas, sight, 78)
    for number, line in enumerate(wrapped(sight.complaint, PLAIN, width, COMPLAINT)):
        write(canvas, line, (EDGE, y + 6 + number * LINE), COLOURS[State.UNSURE], PLAIN, width_px=width)
    y += 6 + COMPLAINT * LINE
    if sight.belief is not None:
        y = draw_belief(canvas, sight.belief, y)
    if sight.back_projection is not None:
        draw_inset(canvas, sight.back_projection, y, INSET[sight.belief is None])


def _draw_legend(canvas: Picture, sight: Sight, y: int) -> int:
    for part, state in zip(sight.body_parts, sight.tracks.states, strict=True):
        draw_mark(canvas, (EDGE + 9, y), state, 8)
        name = part.replace("_", " ")
        write(canvas, name, (EDGE + 30, y + 5), BRIGHT, PLAIN, width_px=110)
        write(canvas, state.value, (EDGE + 146, y + 5), COLOURS[state], PLAIN)
        y += 25
    return y


def draw_belief(canvas: Picture, belief: Belief, y: int) -> int:
    """A bar for each movement, as long as it is probable, and one for rest; gives the place below, px."""
    width = canvas.shape[1] - 2 * EDGE
    write(canvas, f"belief: entropy {belief.entropy_bits:.2f} bit", (EDGE, y + 6), BRIGHT, PLAIN, width_px=width)
    y += 14
    for index in belief.shown(MOVEMENTS):
        won = index == belief.winner
        _draw_bar(canvas, y, belief.labels[index], float(belief.p[index]), WINNER if won else BAR, won)
        y += ROW
    left_out = len(belief.labels) - MOVEMENTS
    if left_out > 0:
        write(canvas, f"and {left_out} less probable", (EDGE, y + 14), DIM, SMALL, width_px=width)
        y += LINE
    _draw_bar(canvas, y + 5, "(at rest)", belief.rest, REST, False)
    return y + ROW + 10


def _draw_bar(canvas: Picture, y: int, label: str, share: float, colour: Colour, won: bool) -> None:
    names, number = canvas.shape[1] * 2 // 5, f"{100 * share:.0f} %"
    room = names - EDGE - 8
    size = PLAIN if width_of(label) <= room else SMALL
    write(canvas, label, (EDGE, y + 16), WINNER if won else DIM, size, width_px=room, bold=won)
    left, right = bar_ends(canvas.shape[1])
    cv2.rectangle(canvas, (left, y + 4), (right - 1, y + ROW - 5), TRACK, -1)
    long = round(min(max(share, 0.0), 1.0) * (right - left))
    if long:
        cv2.rectangle(canvas, (left, y + 4), (left + long - 1, y + ROW - 5), colour, -1)
    write(canvas, number, (canvas.shape[1] - 8 - width_of(number, SMALL), y + 16), BRIGHT if won else DIM, SMALL)


def bar_ends(width_px: int) -> tuple[int, int]:
    """From where, and up to where, a bar reaches on a panel so wide when it stands for nothing and for certainty."""
    return width_px * 2 // 5, width_px - 58


def draw_inset(canvas: Picture, back: Picture, y: int, most: int) -> None:
    """(H, W) uint8 at the bottom, as large as the room below `y` allows: white where skin colour is."""
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
