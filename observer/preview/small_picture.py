"""What an observer sees in one frame, and the picture of it: marks, skeleton and states; a JPEG of bounded size.

The live picture, clips, `look` and the demo's film show the same.
"""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from observer.tracks import Floats, Picture, SeenPeople, State, Tracks

MOTION_MARGIN = 0.15
"""Margin about recorded motion, as a share of the person's extent."""

Colour = tuple[int, int, int]
"""Blue, green, red, 0 to 255."""
STATE_COLOUR: dict[State, Colour] = {
    State.SEEN: (233, 180, 86),
    State.UNSURE: (66, 228, 240),
    State.MISSING: (0, 94, 213),
}
"""Sky blue, yellow and vermilion of the palette of Okabe and Ito, distinguishable with colour blindness and in grey."""
FOLLOWED, OTHER = STATE_COLOUR[State.SEEN], (190, 190, 190)
"""Colours of the frames around the followed person and around others."""
BLACK: Colour = (0, 0, 0)
WHITE: Colour = (255, 255, 255)
FONT, SMALL = cv2.FONT_HERSHEY_SIMPLEX, 0.42
"""Font, and its scale."""
LINE_PX = 15
"""Height of a line of text, px."""
DOT_PX = 5
"""Radius of a mark, px."""
DASHES = 8
"""Number of dashes of an unsure part's ring."""
LETTERS = {"left_hand": "L", "right_hand": "R"}
"""Beside the marks of the hands: the person's own left and right."""
DRAWN_LIMBS = (("shoulder", "elbow"), ("elbow", "hand"), ("shoulder", "hip"), ("hip", "knee"), ("knee", "foot"))
BONES = (
    *(("head", "neck"), ("left_shoulder", "right_shoulder"), ("left_hip", "right_hip")),
    *((f"{side}_{upper}", f"{side}_{lower}") for side in ("left", "right") for upper, lower in DRAWN_LIMBS),
)
"""Lines of the skeleton, drawn between parts that are both seen."""
ALL_STATES = 4
"""With more parts than this, only those that are not seen are listed."""
SHEET_GREY = 46
"""Grey level of the sheet for motion without a picture."""
QUALITIES = (75, 60, 45, 30, 20)
"""JPEG qualities, tried in this order until a picture is small enough."""
SMALLER_SCALE = 0.7
"""Scale of a picture that is too large even at the lowest quality."""


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """One frame as an observer saw it. picture: None for motion without pictures, which `extent` places (2, 2).

    tracks: of `body_parts`, in px of the picture or in any unit without one. captured_ns: of the frame.
    """

    picture: Picture | None
    tracks: Tracks
    body_parts: Sequence[str]
    captured_ns: int
    extent: Floats | None = None


class MotionExtent:
    """The extent of all motion so far; it never shrinks, so that the scale of the picture stays steady.

    corners: (2, 2); None before any motion was seen.
    """

    def __init__(self) -> None:
        self._person_size = 0.0
        self.corners: Floats | None = None

    def widen(self, centres: Floats) -> None:
        """Take in (P, 2) centres, NaN where not seen."""
        seen = centres[np.isfinite(centres).all(axis=1)]
        if not len(seen):
            return
        self._person_size = max(self._person_size, float(np.linalg.norm(seen[:, None] - seen[None], axis=-1).max()))
        margin = MOTION_MARGIN * self._person_size
        corners = np.array([seen.min(axis=0) - margin, seen.max(axis=0) + margin])
        if self.corners is not None:
            corners = np.array([np.minimum(corners[0], self.corners[0]), np.maximum(corners[1], self.corners[1])])
        self.corners = corners


def small_picture(sighting: Sighting, side_px: int) -> Picture:
    """(h, w, 3) BGR whose longer side is at most `side_px`, with marks, skeleton and the state of each part.

    Frames are drawn around several people. The sighting's own picture is not changed.
    """
    if sighting.picture is None:
        canvas: Picture = np.full((side_px * 3 // 4, side_px, 3), SHEET_GREY, np.uint8)
        placement = Placement.of_motion(sighting.extent, (side_px, side_px * 3 // 4))
    else:
        canvas = _reduced(sighting.picture, side_px)
        placement = Placement.of_picture(sighting.picture.shape[1], canvas.shape[1])
    tracks = sighting.tracks
    if tracks.people is not None and tracks.people.others:
        _draw_people(canvas, placement, tracks.people)
    for body in (*(Tracks(person.centres) for person in tracks.persons[1:]), tracks):
        _draw_body(canvas, placement, body, sighting.body_parts)
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


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Maps positions of the source to a picture: scale times position plus shift (2,) px."""

    scale: float
    shift: Floats

    @classmethod
    def of_picture(cls, width_px: int, drawn_px: int) -> Self:
        """For a picture of a width that is drawn with another one; positions are pixel centres."""
        scale = drawn_px / width_px
        return cls(scale, np.full(2, 0.5 * scale - 0.5))

    @classmethod
    def of_motion(cls, extent: Floats | None, size_px: tuple[int, int]) -> Self:
        """For the (2, 2) corners of all motion so far, in any unit, centred in a picture of that width and height."""
        if extent is None:
            return cls(1.0, np.zeros(2))
        size = np.array(size_px, dtype=np.float64)
        scale = float((size / np.maximum(extent[1] - extent[0], 1e-9)).min())
        return cls(scale, size / 2 - scale * extent.mean(axis=0))

    def px(self, positions: Floats) -> Floats:
        """(..., 2) positions of the source -> (..., 2) px in the picture; NaN stays NaN."""
        return positions * self.scale + self.shift


def write_line(canvas: Picture, number: int, text: str, colour: Colour) -> None:
    """Write the line of this number, from 1 at the top, on black, truncated with two dots to the picture."""
    text = fitting(text, canvas.shape[1] - 8)
    width = width_of(text) + 8
    cv2.rectangle(canvas, (0, (number - 1) * LINE_PX), (width, number * LINE_PX), BLACK, -1)
    cv2.putText(canvas, text, (4, number * LINE_PX - 4), FONT, SMALL, colour, 1, cv2.LINE_AA)


def plain(text: str) -> str:
    """The text in ASCII: accents removed, other characters as question marks, line ends as blanks."""
    bare = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    return "".join(c if " " <= c <= "~" else "?" for c in " ".join(bare.split()))


def width_of(text: str) -> int:
    """Width in px of a text as it is drawn."""
    return int(cv2.getTextSize(plain(text), FONT, SMALL, 1)[0][0])


def fitting(text: str, width_px: int) -> str:
    """The text in ASCII, truncated with two dots to `width_px`; "" when nothing fits."""
    text = plain(text)
    if width_of(text) <= width_px:
        return text
    return next((f"{text[:n]}.." for n in range(len(text), 0, -1) if width_of(f"{text[:n]}..") <= width_px), "")


def _reduced(picture: Picture, side_px: int) -> Picture:
    """A copy that may be drawn on, never larger than the picture."""
    scale = min(1.0, side_px / max(picture.shape[:2]))
    size = max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale))
    small = picture.copy() if scale == 1.0 else cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def _draw_body(canvas: Picture, placement: Placement, tracks: Tracks, parts: Sequence[str]) -> None:
    """The bones, and a mark for each part that is seen or guessed."""
    states, centres = tracks.states, placement.px(tracks.centres)
    guesses = centres if tracks.guesses is None else placement.px(tracks.guesses)
    _draw_bones(canvas, centres, parts, states)
    for row, (part, state) in enumerate(zip(parts, states, strict=True)):
        at = _pixel(canvas, centres[row] if state is State.SEEN else guesses[row])
        if at is not None:
            _draw_mark(canvas, at, state)
            _outlined(canvas, LETTERS.get(part, ""), (at[0] + DOT_PX + 3, at[1] + 4), WHITE)


def _draw_bones(canvas: Picture, centres: Floats, body_parts: Sequence[str], states: Sequence[State]) -> None:
    rows = {part: row for row, part in enumerate(body_parts)}
    for ends in BONES:
        if all(end in rows and states[rows[end]] is State.SEEN for end in ends):
            begin, end = (_clipped(centres[rows[end]]) for end in ends)
            for colour, wide in ((BLACK, 4), (STATE_COLOUR[State.SEEN], 2)):
                cv2.line(canvas, begin, end, colour, wide, cv2.LINE_AA)


def _draw_mark(canvas: Picture, at: tuple[int, int], state: State) -> None:
    """A ring with a filled middle (seen), or a dashed, empty ring (unsure)."""
    colour = STATE_COLOUR[state]
    for inked, width in ((BLACK, 5), (colour, 2)):
        if state is State.SEEN:
            cv2.circle(canvas, at, DOT_PX, inked, width, cv2.LINE_AA)
            continue
        for dash in range(DASHES):
            begin = dash * 360 / DASHES
            cv2.ellipse(canvas, at, (DOT_PX, DOT_PX), 0, begin, begin + 200 / DASHES, inked, width, cv2.LINE_AA)
    if state is State.SEEN:
        cv2.circle(canvas, at, DOT_PX // 3 + 2, BLACK, -1, cv2.LINE_AA)
        cv2.circle(canvas, at, DOT_PX // 3, colour, -1, cv2.LINE_AA)


def _draw_people(canvas: Picture, placement: Placement, people: SeenPeople) -> None:
    """Draw a thick frame around the followed person, named, and a thin one around each of the others."""
    for outline in (*people.others, *([] if people.followed is None else [people.followed])):
        corners = placement.px(np.array([[outline.left, outline.top], [outline.right, outline.bottom]]))
        begin, end = (_clipped(corner) for corner in corners)
        followed = outline is people.followed
        for inked, width in ((BLACK, 5), (FOLLOWED, 2)) if followed else ((BLACK, 3), (OTHER, 1)):
            cv2.rectangle(canvas, begin, end, inked, width)
        if followed:
            _outlined(canvas, "followed", (max(begin[0] + 6, 6), max(begin[1] + 20, 20)), FOLLOWED)


def _write_states(canvas: Picture, sighting: Sighting) -> None:
    """The state of each part in the corner; of a whole body how many are seen, and the others by name."""
    pairs = list(zip(sighting.body_parts, sighting.tracks.states, strict=True))
    unseen = [pair for pair in pairs if pair[1] is not State.SEEN]
    number = 1
    if len(pairs) > ALL_STATES:
        write_line(canvas, 1, f"{len(pairs) - len(unseen)} of {len(pairs)} parts seen", STATE_COLOUR[State.SEEN])
        pairs, number = unseen[:ALL_STATES], 2
    for line, (part, state) in enumerate(pairs, number):
        write_line(canvas, line, f"{part.replace('_', ' ')} {state}", STATE_COLOUR[state])


def _outlined(canvas: Picture, text: str, at: tuple[int, int], colour: Colour) -> None:
    """Text at `at` (left end of the base line, px) with a black edge."""
    for inked, width in ((BLACK, 4), (colour, 1)):
        cv2.putText(canvas, text, at, FONT, SMALL, inked, width, cv2.LINE_AA)


def _clipped(position: Floats) -> tuple[int, int]:
    u, v = np.clip(position, -9999, 9999).round().astype(int).tolist()
    return u, v


def _pixel(canvas: Picture, position: Floats) -> tuple[int, int] | None:
    """The pixel, or None for an unknown position and one outside the canvas."""
    height, width = canvas.shape[:2]
    inside = np.isfinite(position).all() and -1 < position[0] < width and -1 < position[1] < height
    return _clipped(position) if inside else None
