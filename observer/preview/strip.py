"""The strip of Vector Symbols: one row a body part, one column a frame, the newest at the right."""

import math

import cv2

from observer.preview.lettering import PLAIN, SMALL, Colour, write
from observer.preview.sight import SYMBOLS, Picture, Sight
from observer.space import VectorSymbol

GROUND: Colour = (38, 34, 32)
LINE: Colour = (70, 64, 60)
NAME: Colour = (225, 225, 225)
STILL: Colour = (125, 120, 115)
ARROW: Colour = (255, 255, 255)
NAMES = 112
"""Width of the column with the names, px."""


def draw_strip(canvas: Picture, sight: Sight) -> None:
    """An arrow for each motion (up is up in the picture), a dot for stillness, a gap where a part was not seen."""
    height, width = canvas.shape[:2]
    canvas[:] = GROUND
    row_height = (height - 16) / len(sight.body_parts)
    step = (width - NAMES - 12) / SYMBOLS
    write(canvas, "motion, newest right; dot: still, gap: not seen", (NAMES, height - 4), STILL, SMALL)
    for row, part in enumerate(sight.body_parts):
        middle = 4 + round((row + 0.5) * row_height)
        write(canvas, part.replace("_", " "), (12, middle + 5), NAME, PLAIN, width_px=NAMES - 18)
        for back, symbol in enumerate(reversed(sight.symbols[-SYMBOLS:, row].tolist())):
            right = width - 12 - round(back * step)
            if symbol != VectorSymbol.NOT_SEEN:
                cv2.line(canvas, (right - round(step), middle), (right, middle), LINE, 1)
            draw_symbol(canvas, (right - round(step / 2), middle), VectorSymbol(symbol), 0.38 * min(step, row_height))


def draw_symbol(canvas: Picture, at: tuple[int, int], symbol: VectorSymbol, half: float) -> None:
    """One symbol about `at`; `half` is half an arrow's length, px. NOT_SEEN leaves a gap."""
    if symbol is VectorSymbol.O:
        cv2.circle(canvas, at, 2, STILL, -1, cv2.LINE_AA)
    elif symbol is not VectorSymbol.NOT_SEEN:
        turn = (symbol - VectorSymbol.U) * math.pi / 4
        du, dv = round(half * math.sin(turn)), round(-half * math.cos(turn))
        begin, end = (at[0] - du, at[1] - dv), (at[0] + du, at[1] + dv)
        cv2.arrowedLine(canvas, begin, end, ARROW, 2, cv2.LINE_AA, tipLength=0.45)
