"""Records the takes of a lesson out of one observer's tracks, one at a time, or something else in pieces. Pure.

1. A take ends when the person stands still, or when the teacher ends it (`observer.teaching.take_watch`).
2. The report says why a take cannot be used; the lesson goes on.
3. Something else is written in pieces of PIECE_S, so that little of it is lost when the process is killed.

Times are those of frames, in ns.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from common.errors import BadInput, LabanmeshError
from common.teaching_messages import (
    SHOWN_UNITS,
    SOMEONE,
    TEACHING_TEXT_LIMIT,
    UNSEEN,
    ShownTracks,
    Side,
    TakeReport,
    TakeState,
    TeachRequest,
)
from observer.recording.own_tracks import TracksRecorder, trimmed, watched_parts
from observer.teaching.take_watch import ClapWatch, StillnessStream, TakeWatch
from observer.tracks import Tracks

if TYPE_CHECKING:
    from observer.teaching.takes_file import TakesFile

PIECE_S = 20.0
SHORTEST_S = 0.4
"""No movement that a person means is shorter."""
NOW_S = 0.7
"""Seconds of the newest tracks that a teacher is shown."""
NO_PICTURES = "no pictures"
LOST = "no pictures any more: is the camera working?"
SHOWN_FRAMES = 24
"""With the 17 parts of a whole body that is 2.5 kB."""
COMPANY_S = 3.0
"""A second person counts when seen for this long, because a tracker sometimes takes a coat for a person."""


@dataclass(slots=True)
class CurrentTake:
    """The take that is recorded now. watch: its begin and end; None for something else.

    piece_ns: begin of the piece of something else that is not written yet. people: the most people who were in the
    picture for COMPANY_S. side: where among them the performer was, `left`, `middle` or `right` in the picture.
    """

    label: str
    take: int
    person: str
    watch: TakeWatch | None
    piece_ns: int = 0
    people: int = 0
    side: Side | None = None

    def is_asked_by(self, request: TeachRequest) -> bool:
        """Whether the request is about this take."""
        return (self.label, self.take) == (request.label, request.take)


class TakeRecorder:
    """Cuts takes out of the observer's own tracks, which `recorder` has, and writes them. Not thread-safe."""

    def __init__(self, recorder: TracksRecorder, takes: "TakesFile") -> None:
        self._recorder, self._takes = recorder, takes
        self._watched = watched_parts(recorder.body_parts)
        self._rows = [recorder.body_parts.index(part) for part in self._watched]
        self.stillness = StillnessStream(self._watched, recorder.rate_hz)
        self.claps, self.people = ClapWatch(recorder.body_parts), PeopleCount()
        self._last: TakeReport | None = None
        self.current: CurrentTake | None = None
        """The take that is recorded now; None: nothing is."""

    @property
    def report(self) -> TakeReport | None:
        """The take that is recorded now, else the last one; None before the first."""
        current = self.current
        if current is None or current.watch is None:
            return self._last
        state: TakeState = "waiting" if current.watch.phase == "waiting" else "moving"
        return self._report(current, state, current.watch.seconds)

    def shown(self, request: TeachRequest) -> ShownTracks | None:
        """The take that a request names; without a label what is seen now. None: there is none."""
        parts = self._recorder.body_parts
        if not request.label:
            newest = self._recorder.newest(NOW_S)
            return shown_tracks(newest, parts, max(len(newest), 1) / NOW_S)
        take = self._takes.take(request.label, str(request.take))
        return None if take is None else shown_tracks(take.positions, parts, take.rate_hz)

    def step(self, at_ns: int, tracks: Tracks, complaint: str = "") -> None:
        """Take in one frame, which the recorder has, and whose people have been counted."""
        self.claps.update(at_ns, tracks)
        tracks = Tracks(tracks.centres[self._rows])
        self.stillness.update(at_ns, tracks)
        current = self.current
        if current is None:
            return
        current.people = max(current.people, self.people.lasting)
        current.side = self.people.side or current.side
        if current.watch is None:
            if at_ns - current.piece_ns >= PIECE_S * SECOND_NS:
                self._write_piece(current, at_ns)
            return
        current.watch.update(at_ns, self.stillness.probability, tracks, complaint)
        if current.watch.phase == "done":
            self._finish(current)

    def forget(self) -> None:
        """Forget the present and the last take: another lesson begins."""
        self.current = self._last = None

    def begin(self, request: TeachRequest, pictures: bool) -> str:
        """Begin a take, or something else for a request without a label; returns why not, "" if it began."""
        if self.current is not None:
            return "" if self.current.is_asked_by(request) else "another take is being recorded; end it first"
        newest_ns = self._recorder.newest_ns
        if newest_ns is None or not pictures:
            self._last = TakeReport(label=request.label, take=request.take, state="failed", fault=NO_PICTURES)
            return "no pictures now: is the camera working?"
        watch = TakeWatch(newest_ns) if request.label else None
        self.current = CurrentTake(request.label, request.take, request.person or SOMEONE, watch, newest_ns)
        self._last = None
        return ""

    def abandon(self) -> None:
        """Stop because the teacher has gone: what was recorded of something else is kept, a take is not."""
        current, self.current = self.current, None
        if current is not None and current.watch is None and self._recorder.newest_ns is not None:
            self._write_piece(current, self._recorder.newest_ns)

    def end(self) -> None:
        """End what is recorded now, as the teacher asks."""
        current = self.current
        if current is None:
            return
        if current.watch is None:
            self.current = None
            self._write_piece(current, self._recorder.newest_ns or 0)
            return
        current.watch.end()
        self._finish(current)

    def lose(self) -> None:
        """Note that no pictures come any more: a take fails at once; something else goes on when they come again."""
        current = self.current
        if current is not None and current.watch is not None:
            current.watch.end(LOST)
            self._finish(current)

    def _finish(self, current: CurrentTake) -> None:
        """Cut the take out, write it, and keep the report for the next reply."""
        watch = current.watch
        self.current = None
        fault, seconds = "", 0.0
        if watch is not None and not (fault := watch.fault):
            seconds = watch.seconds
            try:
                seconds = self._keep(current, watch.begin_ns, watch.end_ns)
            except LabanmeshError as error:
                fault = fault_line(error)
        state: TakeState = "failed" if fault else "kept"
        self._last = self._report(current, state, seconds, fault)

    def _report(self, current: CurrentTake, state: TakeState, seconds: float, fault: str = "") -> TakeReport:
        return TakeReport(
            label=current.label, take=current.take, state=state, seconds=seconds, fault=fault, people=current.people,
            side=current.side,
        )  # fmt: skip

    def _keep(self, current: CurrentTake, begin_ns: int, end_ns: int) -> float:
        """Write a take without the rest before and after it; returns its length in seconds."""
        cut = self._recorder.cut(begin_ns, end_ns, label=current.label, subject=current.person, trial=str(current.take))
        take = trimmed(cut, self._recorder.body_parts, self._watched)
        seconds = len(take.positions) / take.rate_hz
        if seconds < SHORTEST_S:
            raise BadInput(
                f"{seconds:.1f} s is too short for a movement: begin after the signal, and stand still after it"
            )
        self._takes.add(take)
        return seconds

    def _write_piece(self, current: CurrentTake, end_ns: int) -> None:
        """Write the newest piece of something else, unless nobody was seen in it."""
        begin_ns, current.piece_ns = current.piece_ns, end_ns
        fault = ""
        try:
            self._takes.add(self._recorder.cut(begin_ns, end_ns, subject=current.person))
        except BadInput:
            pass  # an empty room teaches nothing
        except LabanmeshError as error:
            fault = fault_line(error)
        state: TakeState = "failed" if fault else "kept"
        self._last = TakeReport(label="", take=current.take, state=state, seconds=self._takes.other_s, fault=fault)


class PeopleCount:
    """How many people are in the picture, now and for a while. now: None if the tracker does not tell."""

    def __init__(self) -> None:
        self.now: int | None = None
        self.side: Side | None = None
        """Of the picture on which the one is whose tracks are recorded, among several."""
        self._since_ns: int | None = None
        self._newest_ns = 0

    @property
    def lasting(self) -> int:
        """The people of now, if there have been several for COMPANY_S; else at most one."""
        if self._since_ns is None or self._newest_ns - self._since_ns < COMPANY_S * SECOND_NS:
            return min(self.now or 0, 1)
        return self.now or 0

    def update(self, at_ns: int, tracks: Tracks) -> None:
        """Take in one frame."""
        self.now, self._newest_ns = None if tracks.people is None else tracks.people.count, at_ns
        self.side = None if tracks.people is None else tracks.people.side
        self._since_ns = None if (self.now or 0) < 2 else min(self._since_ns or at_ns, at_ns)


def shown_tracks(centres: NDArray[np.floating[Any]], body_parts: Sequence[str], rate_hz: float) -> ShownTracks | None:
    """Frames of `centres` (F, P, 2), in any unit, thinned to at most SHOWN_FRAMES; None if nothing is seen in them.

    rate_hz: frames per second before they are thinned.
    """
    visible: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(centres), axis=2)
    if not visible.any():
        return None
    chosen = np.unique(np.linspace(0, len(centres) - 1, min(len(centres), SHOWN_FRAMES)).round().astype(int))
    left, top = np.nanmin(np.where(visible[..., None], centres, np.nan), axis=(0, 1))
    right, bottom = np.nanmax(np.where(visible[..., None], centres, np.nan), axis=(0, 1))
    size = max(float(right - left), float(bottom - top)) or 1.0
    scaled = (centres[chosen] - (left, top)) / size * SHOWN_UNITS
    points = np.where(visible[chosen][..., None], scaled, UNSEEN).round().astype(int)
    return ShownTracks(
        body_parts=list(body_parts),
        points=points.ravel().tolist(),
        seconds=len(centres) / rate_hz,
        left=float(left),
        top=float(top),
        size=size,
    )


def fault_line(error: LabanmeshError) -> str:
    """The error for a teacher, who cannot choose another path."""
    return str(error).split(". Choose another path")[0][:TEACHING_TEXT_LIMIT]
