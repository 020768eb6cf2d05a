"""One line of a foreign tracker's output, JSON to centres, and the tracker that classifies them; pure."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, PositiveInt, ValidationError

from common.errors import BadInput
from observer.tracks import Frame, Tracks

Place = tuple[FiniteFloat, FiniteFloat] | tuple[FiniteFloat, FiniteFloat, Annotated[FiniteFloat, Field(ge=0, le=1)]]
LIMIT = 64 * 1024
"""Bytes of a line; trackers with hundreds of key points stay below it."""


class TrackLine(BaseModel):
    """The keys of a line. parts: name -> [u, v] or [u, v, confidence], u right, v DOWN, any unit; null: not seen.

    captured_ns: Unix epoch, when the picture was taken; without it the time of arrival counts. Keys that we do not know
    are let pass: trackers say more than we need.
    """

    model_config = ConfigDict(extra="ignore", frozen=True)
    captured_ns: PositiveInt | None = None
    parts: dict[str, Place | None]


def frame_of_line(line: bytes, body_parts: Sequence[str], arrived_ns: int) -> Frame:
    """Content (P, 3): u, v and confidence (1 where the line gives none) of `body_parts`; a row of NaN: not seen.

    Raises BadInput, one line, for what is no such line, and for one that names none of the parts.
    """
    if len(line) > LIMIT:
        raise BadInput(f"{len(line)} bytes in one line; at most {LIMIT} are read")
    try:
        said = TrackLine.model_validate_json(line)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the line"
        raise BadInput(f"{where}: {first['msg']}; e.g. {EXAMPLE}") from None
    if not any(part in said.parts for part in body_parts):
        raise BadInput(f"parts: {', '.join(said.parts) or 'none'}; known: {', '.join(body_parts)}")
    places = np.full((len(body_parts), 3), np.nan)
    for row, part in enumerate(body_parts):
        place = said.parts.get(part)
        if place is not None:
            places[row] = (*place, 1.0)[:3]
    return Frame(said.captured_ns or arrived_ns, places)


EXAMPLE = '{"captured_ns": 1700000000000000000, "parts": {"left_hand": [412, 300, 0.9], "right_hand": null}}'
"""A line as docs/reference/tracks.md shows it."""


SURE = 0.5
"""Confidence from which on a part counts as seen, as most trackers mean theirs; below it is a guess."""


class ForeignTracker:
    """A `observer.tracks.Tracker` of frames whose content is (P, 3): u, v, confidence 0 to 1; NaN: not seen."""

    def __init__(self, body_parts: Sequence[str]) -> None:
        self.body_parts = tuple(body_parts)

    def update(self, frame: Frame) -> Tracks:
        """Centres where confidence ≥ 0.5, guesses below."""
        sure = frame.content[:, 2:] >= SURE
        places = frame.content[:, :2].astype(np.float64)
        return Tracks(np.where(sure, places, np.nan), np.where(sure, np.nan, places))
