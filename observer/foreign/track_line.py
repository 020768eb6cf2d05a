"""A foreign tracker's line (docs/guide/cameras.md): JSON to centres, and their classification; pure."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from common.errors import BadInput
from observer.tracking.person_keeper import PersonKeeper, detection_of, rows_of_people, seen_people
from observer.tracks import Frame, Tracks

LARGEST_COORDINATE = 1e12
"""Of a coordinate, in any unit: the squares of larger ones would overflow float32, and the model would say NaN."""
Coordinate = Annotated[FiniteFloat, Field(ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE)]
Position = tuple[Coordinate, Coordinate] | tuple[Coordinate, Coordinate, Annotated[FiniteFloat, Field(ge=0, le=1)]]
MAX_BYTES = 64 * 1024
"""Longest line; trackers with hundreds of key points stay below it."""
LATEST_NS = 2**63 - 1
"""The last time that a message can carry: the year 2262."""
SEEN_CONFIDENCE = 0.5
"""Confidence from which a part counts as seen, as most trackers mean theirs; below it the position is a guess."""
EXAMPLE = '{"captured_ns": 1700000000000000000, "parts": {"left_hand": [412, 300, 0.9], "right_hand": null}}'


class TrackLine(BaseModel):
    """The keys of a line. parts: name -> [u, v] or [u, v, confidence], u right, v DOWN, any unit; null: not seen.

    captured_ns: capture time (Unix epoch, ns); without it the time of arrival counts. Unknown keys are ignored, since
    trackers send more than is needed here.
    """

    model_config = ConfigDict(extra="ignore", frozen=True)
    captured_ns: Annotated[int, Field(gt=0, le=LATEST_NS)] | None = None
    parts: dict[str, Position | None]


def frame_of_line(line: bytes, body_parts: Sequence[str], arrived_ns: int) -> Frame:
    """A frame whose content is (P, 3): u, v and confidence (1 where absent) of `body_parts`; a row of NaN: not seen.

    Raises BadInput, one line, for a malformed line, a capture time out of range and a line without any of the parts.
    """
    if len(line) > MAX_BYTES:
        raise BadInput(f"{len(line)} bytes in one line; at most {MAX_BYTES} are read")
    try:
        message = TrackLine.model_validate_json(line)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the line"
        raise BadInput(f"{where}: {first['msg']}; e.g. {EXAMPLE}") from None
    if not any(part in message.parts for part in body_parts):
        raise BadInput(f"parts: {', '.join(message.parts) or 'none'}; known: {', '.join(body_parts)}")
    rows = np.full((len(body_parts), 3), np.nan)
    for row, part in enumerate(body_parts):
        position = message.parts.get(part)
        if position is not None:
            rows[row] = (*position, 1.0)[:3]
    return Frame(message.captured_ns or arrived_ns, rows)


class ForeignTracker:
    """A `Tracker` of frames whose content is (P, 3): u, v, confidence 0 to 1; NaN: not seen."""

    def __init__(self, body_parts: Sequence[str]) -> None:
        self.body_parts = tuple(body_parts)

    def update(self, frame: Frame) -> Tracks:
        """Centres where the confidence is at least SEEN_CONFIDENCE, guesses below."""
        sure = frame.content[:, 2:] >= SEEN_CONFIDENCE
        positions = frame.content[:, :2].astype(np.float64)
        return Tracks(np.where(sure, positions, np.nan), np.where(sure, np.nan, positions))


class ForeignPeople:
    """A `Tracker` of several people, at most `most`, of frames as `ForeignTracker` reads them; recorded: their rows."""

    def __init__(self, recorded: Sequence[str], most: int) -> None:
        self.body_parts, self._rows = rows_of_people(recorded)
        self._keeper, self.most = PersonKeeper(most), most

    def update(self, frame: Frame) -> Tracks:
        """The people who are seen, whichever of the rows they have in this frame."""
        bodies = []
        for rows in self._rows:
            content = frame.content[rows]
            centres = np.where(content[:, 2:] >= SEEN_CONFIDENCE, content[:, :2].astype(np.float64), np.nan)
            body = detection_of(centres, centres[np.isfinite(centres).all(axis=1)])
            bodies += [] if body is None else [body]
        persons = self._keeper.update(bodies, frame.at_ns)
        nobody = np.full((len(self.body_parts), 2), np.nan)
        return Tracks(persons[0].centres if persons else nobody, people=seen_people(persons), persons=persons)
