"""Marks on a picture: where each body part is, how sure that is, and which way it came."""

import math

import cv2
import numpy as np

from observer.preview.layout import Placement
from observer.preview.lettering import SMALL, Colour, width_of, write
from observer.preview.sight import Picture, Sight
from observer.tracks import Floats, State

COLOURS: dict[State, Colour] = {
    State.SEEN: (233, 180, 86),
    State.UNSURE: (66, 228, 240),
    State.MISSING: (0, 94, 213),
}
"""Sky blue, yellow, vermilion of Okabe and Ito's palette: told apart by who is colour-blind, and also in grey."""

RADIUS = 14
"""Of a ring, px."""
DASHES = 8
"""Of an unsure part's ring."""
BLACK: Colour = (0, 0, 0)


def draw_marks(canvas: Picture, placement: Placement, sight: Sight) -> None:
    """Trails first, then a mark with its name for each part that is seen or guessed at."""
    _draw_trails(canvas, placement.px(sight.trail))
    centres, states = placement.px(sight.tracks.centres), sight.tracks.states
    guesses = None if sight.tracks.guesses is None else placement.px(sight.tracks.guesses)
    for row, (part, state) in enumerate(zip(sight.body_parts, states, strict=True)):
        place = centres[row] if state is State.SEEN or guesses is None else guesses[row]
        at = _on(canvas, place)
        if at is not None:
            draw_mark(canvas, at, state)
            _name(canvas, at, part)


def draw_mark(canvas: Picture, at: tuple[int, int], state: State, radius: int = RADIUS) -> None:
    """Seen: a ring with a filled middle; unsure: a dashed, empty ring; missing: a cross. Colours as COLOURS."""
    colour = COLOURS[state]
    if state is State.SEEN:
        for inked, width in ((BLACK, 5), (colour, 2)):
            cv2.circle(canvas, at, radius, inked, width, cv2.LINE_AA)
        cv2.circle(canvas, at, radius // 3 + 2, BLACK, -1, cv2.LINE_AA)
        cv2.circle(canvas, at, radius // 3, colour, -1, cv2.LINE_AA)
    elif state is State.UNSURE:
        for inked, width in ((BLACK, 5), (colour, 2)):
            for dash in range(DASHES):
                begin = dash * 360 / DASHES
                cv2.ellipse(canvas, at, (radius, radius), 0, begin, begin + 200 / DASHES, inked, width, cv2.LINE_AA)
    else:
        half = radius * 2 // 3
        for inked, width in ((BLACK, 5), (colour, 2)):
            for rise in (-half, half):
                ends = (at[0] - half, at[1] - rise), (at[0] + half, at[1] + rise)
                cv2.line(canvas, *ends, inked, width, cv2.LINE_AA)


def _draw_trails(canvas: Picture, trail: Floats) -> None:
    """Thin where it is old, so that it shows which way the part went."""
    # All of the black edge first, or each piece would cut the one before it.
    for inked, edge in ((BLACK, 2), (COLOURS[State.SEEN], 0)):
        for row in range(trail.shape[1]):
            for i in range(1, len(trail)):
                begin, end = _on(canvas, trail[i - 1, row]), _on(canvas, trail[i, row])
                if begin is not None and end is not None:
                    width = 1 + math.floor(3 * i / len(trail)) + edge
                    cv2.line(canvas, begin, end, inked, width, cv2.LINE_AA)


def _name(canvas: Picture, at: tuple[int, int], part: str) -> None:
    """Beside the mark, on the side on which a person's hands do not meet; always inside the picture."""
    text = part.replace("_", " ")
    wide, away = width_of(text, SMALL), RADIUS + 6
    left = {"right_hand": at[0] - away - wide, "head": at[0] - wide // 2}.get(part, at[0] + away)
    base = at[1] - away if part == "head" else at[1] + 4
    height, width = canvas.shape[:2]
    place = (max(min(left, width - wide - 3), 3), min(max(base, 12), height - 4))
    write(canvas, text, place, (255, 255, 255), SMALL, outlined=True)


def _on(canvas: Picture, place: Floats) -> tuple[int, int] | None:
    """The pixel, or None for what is not known or not on the canvas."""
    height, width = canvas.shape[:2]
    if not (np.isfinite(place).all() and -1 < place[0] < width and -1 < place[1] < height):
        return None
    return round(float(place[0])), round(float(place[1]))
