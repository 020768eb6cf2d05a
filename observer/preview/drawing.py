"""Layout, text and marks of a painted picture of 1280x720."""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from observer.preview.sight import Picture, Sighting
from observer.tracks import BODY_PARTS, Floats, SeenPeople, State, Tracks

SIZE = (1280, 720)
"""Width and height of every painted picture, px; a video needs a constant size."""
PANEL = (320, 560)
"""Least and greatest width of the panel beside the picture, px."""
CANVAS = (640, 480)
"""Width and height of the empty sheet for recorded motion, px."""


@dataclass(frozen=True, slots=True)
class PixelBox:
    """A rectangle of the painted picture, px."""

    x: int
    y: int
    width: int
    height: int

    def cut(self, canvas: Picture) -> Picture:
        """A view of this part of the canvas; drawing on it is clipped to the box."""
        return canvas[self.y : self.y + self.height, self.x : self.x + self.width]


@dataclass(frozen=True, slots=True)
class PaintingLayout:
    """picture: the source's picture with its aspect ratio. panel: right of it."""

    picture: PixelBox
    panel: PixelBox

    @classmethod
    def of(cls, width_px: int, height_px: int) -> Self:
        """The layout for a source of that size, at least 1 px each way."""
        room, height = SIZE[0] - PANEL[0], SIZE[1]
        scale = min(room / width_px, height / height_px)
        wide, high = (max(1, round(n * scale)) for n in (width_px, height_px))
        panel = min(max(SIZE[0] - wide, PANEL[0]), PANEL[1])
        left = (SIZE[0] - panel - wide) // 2
        return cls(
            PixelBox(left, (height - high) // 2, wide, high),
            PixelBox(SIZE[0] - panel, 0, panel, height),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Maps positions of the source to the box: scale times position plus shift (2,) px."""

    scale: float
    shift: Floats

    @classmethod
    def of_picture(cls, width_px: int, box: PixelBox) -> Self:
        """For a picture of that width, resized into the box; positions are pixel centres."""
        scale = box.width / width_px
        return cls(scale, np.full(2, 0.5 * scale - 0.5))

    @classmethod
    def of_motion(cls, extent: Floats | None, box: PixelBox) -> Self:
        """For the (2, 2) corners of all motion so far, in any unit, centred in the box."""
        if extent is None:
            return cls(1.0, np.zeros(2))
        size = np.array([box.width, box.height], dtype=np.float64)
        sides = np.maximum(extent[1] - extent[0], 1e-9)
        scale = float((size / sides).min())
        return cls(scale, size / 2 - scale * extent.mean(axis=0))

    def px(self, positions: Floats) -> Floats:
        """(..., 2) positions of the source -> (..., 2) px in the box; NaN stays NaN."""
        return positions * self.scale + self.shift


Colour = tuple[int, int, int]
"""Blue, green, red, 0 to 255."""

FONT, BOLD = cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX
SMALL, PLAIN, LARGE = 0.42, 0.5, 0.75
"""Font scales; PLAIN has capitals of about 11 px."""


def write(
    canvas: Picture,
    text: str,
    at: tuple[int, int],
    colour: Colour,
    size: float = PLAIN,
    *,
    width_px: int | None = None,
    bold: bool = False,
    outlined: bool = False,
) -> None:
    """Draw text at `at` (left end of the base line, px), truncated with two dots to `width_px`.

    outlined: with a black edge, for text on a picture.
    """
    text = fitting(text, size, width_px) if width_px is not None else plain(text)
    if outlined:
        cv2.putText(canvas, text, at, FONT, size, (0, 0, 0), 4, cv2.LINE_AA)
    cv2.putText(canvas, text, at, BOLD if bold else FONT, size, colour, 1, cv2.LINE_AA)


def plain(text: str) -> str:
    """The text in ASCII: accents removed, other characters as question marks, line ends as blanks."""
    bare = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    return "".join(c if " " <= c <= "~" else "?" for c in " ".join(bare.split()))


def width_of(text: str, size: float = PLAIN) -> int:
    """Width in px of a text as `write` draws it."""
    return int(cv2.getTextSize(plain(text), FONT, size, 1)[0][0])


def fitting(text: str, size: float, width_px: int) -> str:
    """The text in ASCII, truncated with two dots to `width_px`; "" when nothing fits."""
    text = plain(text)
    if width_of(text, size) <= width_px:
        return text
    low, high = 0, len(text)
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if width_of(text[:middle] + "..", size) <= width_px else (low, middle - 1)
    return text[:low] + ".." if low else ""


def wrapped(text: str, size: float, width_px: int, lines: int) -> list[str]:
    """The text in at most `lines` lines of that width; the last may be too long, and `write` truncates it."""
    words, result = plain(text).split(), [""]
    for word in words:
        longer = f"{result[-1]} {word}".strip()
        if len(result) == lines or not result[-1] or width_of(longer, size) <= width_px:
            result[-1] = longer
        else:
            result.append(word)
    return result


STATE_COLOUR: dict[State, Colour] = {
    State.SEEN: (233, 180, 86),
    State.UNSURE: (66, 228, 240),
    State.MISSING: (0, 94, 213),
}
"""Sky blue, yellow and vermilion of the palette of Okabe and Ito, distinguishable with colour blindness and in grey."""

RING_PX = 14
"""Radius of a ring, px."""
DASHES = 8
"""Number of dashes of an unsure part's ring."""
BLACK: Colour = (0, 0, 0)
DRAWN_LIMBS = (("shoulder", "elbow"), ("elbow", "hand"), ("shoulder", "hip"), ("hip", "knee"), ("knee", "foot"))
BONES = (
    *(("head", "neck"), ("left_shoulder", "right_shoulder"), ("left_hip", "right_hip")),
    *((f"{side}_{upper}", f"{side}_{lower}") for side in ("left", "right") for upper, lower in DRAWN_LIMBS),
)
"""Lines of the skeleton, drawn between parts that are both seen."""
FOLLOWED, OTHER = STATE_COLOUR[State.SEEN], (190, 190, 190)
"""Colours of the frames around the followed person and around others."""
MAIN = (*BODY_PARTS, "left_foot", "right_foot")
MOST_NAMED_PARTS = 6
"""With more parts, only those of MAIN are named and have states."""
JOINT_PX, DOT_PX = 6, 5
"""Radius of the marks of the other parts, and of all parts in a small picture."""
LETTERS = {"left_hand": "L", "right_hand": "R"}
"""Beside the marks of the hands in a small picture: the person's own left and right."""
WHITE: Colour = (255, 255, 255)


def main_rows(body_parts: Sequence[str]) -> list[int]:
    """The rows of the parts that are shown in full."""
    rows = [row for row, part in enumerate(body_parts) if part in MAIN]
    return rows if len(body_parts) > MOST_NAMED_PARTS and rows else list(range(len(body_parts)))


def draw_person(canvas: Picture, placement: Placement, sighting: Sighting, *, named: bool) -> None:
    """Draw each person's skeleton, a mark for each part that is seen or guessed, and frames around several people.

    named: with the names of the parts; otherwise with small marks, and letters beside the hands.
    """
    tracks, parts = sighting.tracks, sighting.body_parts
    if tracks.people is not None and tracks.people.others:
        _draw_people(canvas, placement, tracks.people)
    for body in (*(Tracks(person.centres) for person in tracks.persons[1:]), tracks):
        _draw_body(canvas, placement, body, parts, named)


def _draw_body(canvas: Picture, placement: Placement, tracks: Tracks, parts: Sequence[str], named: bool) -> None:
    main, states = main_rows(parts), tracks.states
    centres = placement.px(tracks.centres)
    guesses = centres if tracks.guesses is None else placement.px(tracks.guesses)
    _draw_bones(canvas, centres, parts, states, 3 if named else 2)
    for row, (part, state) in enumerate(zip(parts, states, strict=True)):
        at = _pixel(canvas, centres[row] if state is State.SEEN else guesses[row])
        if at is None:
            continue
        if not named:
            draw_mark(canvas, at, state, DOT_PX)
            write(canvas, LETTERS.get(part, ""), (at[0] + DOT_PX + 3, at[1] + 4), WHITE, SMALL, outlined=True)
        elif row in main:
            draw_mark(canvas, at, state)
            _name(canvas, at, part)
        else:
            draw_mark(canvas, at, state, JOINT_PX)


def _draw_bones(
    canvas: Picture, centres: Floats, body_parts: Sequence[str], states: Sequence[State], width: int
) -> None:
    rows = {part: row for row, part in enumerate(body_parts)}
    for ends in BONES:
        if all(end in rows and states[rows[end]] is State.SEEN for end in ends):
            begin, end = (tuple(np.clip(centres[rows[end]], -9999, 9999).round().astype(int).tolist()) for end in ends)
            for colour, wide in ((BLACK, width + 2), (STATE_COLOUR[State.SEEN], width)):
                cv2.line(canvas, begin, end, colour, wide, cv2.LINE_AA)


def draw_mark(canvas: Picture, at: tuple[int, int], state: State, radius: int = RING_PX) -> None:
    """Draw a ring with a filled middle (seen), a dashed, empty ring (unsure) or a cross (missing)."""
    colour = STATE_COLOUR[state]
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


def _draw_people(canvas: Picture, placement: Placement, people: SeenPeople) -> None:
    """Draw a thick frame around the followed person, named, and a thin one around each of the others."""
    for outline in (*people.others, *([] if people.followed is None else [people.followed])):
        corners = placement.px(np.array([[outline.left, outline.top], [outline.right, outline.bottom]]))
        begin, end = (tuple(int(value) for value in np.clip(np.round(corner), -9999, 9999)) for corner in corners)
        followed = outline is people.followed
        for inked, width in ((BLACK, 5), (FOLLOWED, 2)) if followed else ((BLACK, 3), (OTHER, 1)):
            cv2.rectangle(canvas, begin, end, inked, width)
        if followed:
            at = (max(begin[0] + 6, 6), max(begin[1] + 20, 20))
            write(canvas, "followed", at, FOLLOWED, SMALL, outlined=True)


def _name(canvas: Picture, at: tuple[int, int], part: str) -> None:
    """Write the name beside the mark, on the outer side of the body, always inside the picture."""
    text = part.replace("_", " ")
    wide, gap = width_of(text, SMALL), RING_PX + 6
    left = at[0] - gap - wide if part.startswith("right_") else at[0] - wide // 2 if part == "head" else at[0] + gap
    base = at[1] - gap if part == "head" else at[1] + 4
    height, width = canvas.shape[:2]
    start = (max(min(left, width - wide - 3), 3), min(max(base, 12), height - 4))
    write(canvas, text, start, WHITE, SMALL, outlined=True)


def _pixel(canvas: Picture, position: Floats) -> tuple[int, int] | None:
    """The pixel, or None for an unknown position and one outside the canvas."""
    height, width = canvas.shape[:2]
    if not (np.isfinite(position).all() and -1 < position[0] < width and -1 < position[1] < height):
        return None
    return round(float(position[0])), round(float(position[1]))
