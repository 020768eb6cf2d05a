"""Examples from verdicts that were wrong or missing: spans of the tracks that an observer remembers. Pure.

A verdict begins when a movement has become likely, and ends when rest has: so the example goes from where the person
began to move to where they stood still again, as a take does. Spans are cut in time of the motion, in ns.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from common.errors import BadInput, LabanmeshError
from common.teaching_messages import CorrectedReport, TeachRequest, only_person
from observer.body import Stillness
from observer.motion.archive import Recording
from observer.recording.own_tracks import MARGIN_S, TracksRecorder, in_parts, watched_parts
from observer.teaching.take_recorder import SHORTEST_S
from observer.tracks import Tracks

if TYPE_CHECKING:
    from observer.teaching.takes_file import TakesFile

STILLNESS_LEAD_S = 6.0
"""Stillness is computed from this long before a span on, because it first has to measure the tracker's noise."""
WIDEN_S = 2.0
"""An example begins and ends no more than this outside of the span: some people never stand still."""
SHORTEST_REST_S = 0.8
"""A shorter rest does not end a movement (`observer.teaching.take_watch.RESTS_S`)."""
NEAR_S = 8.0
"""A movement of which only the moment is known lies within this time of it."""
SPAN_S = 12.0


@dataclass(frozen=True, slots=True)
class CapturedSpan:
    """A span of captured frames, Unix epoch in ns. end_ns None: until the person stands still; equal to begin_ns: the
    movement nearest to that time."""

    begin_ns: int
    end_ns: int | None


class Corrector:
    """Writes examples; `recorder` remembers the tracks that they are cut out of. Not thread-safe."""

    def __init__(self, recorder: TracksRecorder, takes: "TakesFile") -> None:
        self._recorder, self._takes = recorder, takes
        self._done: dict[str, _Correction] = {}
        self._several: list[tuple[int, int]] = []
        """Spans of frames (ns) in which the tracks may be of any of several people."""

    def note_several(self, at_ns: int) -> None:
        """Note that the frame of this time shows several people, of whom nobody has chosen one."""
        begin_ns, newest_ns = self._several.pop() if self._several else (at_ns, at_ns)
        if not 0 <= at_ns - newest_ns <= WIDEN_S * SECOND_NS:
            self._several.append((begin_ns, newest_ns))
            begin_ns = at_ns
        oldest_ns = self._recorder.oldest_ns or 0
        self._several = [*(span for span in self._several if span[1] >= oldest_ns), (begin_ns, at_ns)]

    def _require_one(self, times: CapturedSpan) -> None:
        """Raise BadInput if several people were seen in an example's time."""
        first_ns, last_ns = (self._recorder.at_ns_of(ns) for ns in (times.begin_ns, times.end_ns or times.begin_ns))
        if any(begin_ns <= last_ns and first_ns <= end_ns for begin_ns, end_ns in self._several):
            raise BadInput("saw several people then, and does not know which of them is meant: teach takes of it")

    def correct(self, request: TeachRequest) -> CorrectedReport:
        """Make an example of the span that the request names; a repeated request changes nothing.

        An earlier correction with the same id is replaced. Raises BadInput for a span of which there is no example,
        LabanmeshError if it cannot be written: then it waits in memory.
        """
        earlier, person = self._done.get(request.correction), request.person or only_person(self._takes.persons)
        if earlier is not None and (earlier.report.label, earlier.person) == (request.label, person):
            return earlier.report
        span = CapturedSpan(request.from_ns, request.to_ns or None)
        recording, times = example_of(self._recorder, span, label=request.label, subject=person)
        self._require_one(times)
        number = self._takes.free_take(request.label) if request.label else f"corrected {times.begin_ns}"
        report = CorrectedReport(
            id=request.correction, label=request.label, from_ns=times.begin_ns, to_ns=times.end_ns or 0,
            seconds=len(recording.positions) / recording.rate_hz,
        )  # fmt: skip
        correction = _Correction(report, str(number), person)
        try:
            self._takes.add(replace(recording, trial=correction.trial))
        except BadInput:
            raise
        except LabanmeshError:
            self._replace(earlier, correction)
            raise
        self._replace(earlier, correction)
        return report

    def _replace(self, earlier: "_Correction | None", correction: "_Correction") -> None:
        self._done[correction.report.id] = correction
        if earlier is not None:
            self._takes.drop(earlier.report.label, earlier.trial)


@dataclass(frozen=True, slots=True)
class _Correction:
    """A correction that was made; its example is `trial` of `person`."""

    report: CorrectedReport
    trial: str
    person: str


def example_of(
    recorder: TracksRecorder, span: CapturedSpan, *, label: str, subject: str
) -> tuple[Recording, CapturedSpan]:
    """The remembered tracks of a span as an example of `label` ("": of something else), and when it was captured.

    Raises BadInput, one line, if the recorder remembers nothing of the span, nobody was seen, or nobody moved.
    """
    _require_remembered(recorder, span)
    begin_ns = recorder.at_ns_of(span.begin_ns)
    end_ns = None if span.end_ns is None else max(recorder.at_ns_of(span.end_ns), begin_ns)
    near_s = NEAR_S if end_ns == begin_ns else 0.0
    first_ns = round(begin_ns - (STILLNESS_LEAD_S + near_s) * SECOND_NS)
    last_ns = round((begin_ns if end_ns is None else end_ns) + (SPAN_S if end_ns is None else NEAR_S) * SECOND_NS)
    first_ns = max(first_ns, recorder.oldest_ns or 0)
    around = recorder.cut(first_ns, last_ns, label=label, subject=subject)
    frames = _Frames(around.rate_hz, _moving_runs(around, recorder), len(around.positions))
    begin, end = (round((at_ns - first_ns) / SECOND_NS * around.rate_hz) for at_ns in (begin_ns, end_ns or begin_ns))
    if end_ns is None:
        begin, end = frames.from_here(begin)
    elif near_s:
        begin, end = frames.nearest(begin)
    else:
        begin, end = frames.widened(begin, end, is_movement=bool(label))
    seconds = (end - begin) / around.rate_hz
    if not SHORTEST_S <= seconds <= SPAN_S + 2 * WIDEN_S:
        length = "short" if seconds < SHORTEST_S else "long"
        raise BadInput(f"{seconds:.1f} s is too {length} for a movement; name when it began and ended")
    recording = replace(around, positions=around.positions[begin:end])
    if not np.isfinite(recording.positions).any():
        raise BadInput("saw nobody then")
    times = [recorder.captured_ns_of(first_ns + round(n / around.rate_hz * SECOND_NS)) for n in (begin, end)]
    return recording, CapturedSpan(times[0], times[1])


def _require_remembered(recorder: TracksRecorder, span: CapturedSpan) -> None:
    captured_ns = recorder.captured_ns
    if captured_ns is None:
        raise BadInput("remembers no tracks")
    oldest_ns, newest_ns = captured_ns
    if span.begin_ns < oldest_ns:
        seconds = (newest_ns - oldest_ns) / SECOND_NS
        length = f"{seconds:.0f} s" if seconds < 60 else f"{seconds / 60:.1f} minutes"
        raise BadInput(f"remembers only the last {length}, and this was before")
    if span.begin_ns > newest_ns + SECOND_NS:
        raise BadInput("has no pictures from that time")


@dataclass(frozen=True, slots=True)
class _Frames:
    """Frames around a span. runs: (begin, end) of those in which the person moves; count: of all."""

    rate_hz: float
    runs: list[tuple[int, int]]
    count: int

    def widened(self, begin: int, end: int, *, is_movement: bool) -> tuple[int, int]:
        """The movements that the span touches, from their beginning to their end."""
        touched = [run for run in self.runs if run[0] < end and run[1] > begin]
        if not touched:
            if is_movement:
                raise BadInput("saw nobody move then")
            return begin, end
        widen = round(WIDEN_S * self.rate_hz)
        return self._with_margin(max(touched[0][0], begin - widen), min(touched[-1][1], end + widen))

    def from_here(self, begin: int) -> tuple[int, int]:
        """The movement that goes on in this frame, or that begins next."""
        following = [run for run in self.runs if run[1] > begin]
        if not following:
            raise BadInput("saw nobody move then")
        first, last = following[0]
        return self._with_margin(max(first, begin - round(WIDEN_S * self.rate_hz)), last)

    def nearest(self, frame: int) -> tuple[int, int]:
        """The movement that is nearest to this frame, and no farther than NEAR_S."""
        near, shortest = round(NEAR_S * self.rate_hz), SHORTEST_S * self.rate_hz / 2
        distances = [(max(begin - frame, frame - end, 0), begin, end) for begin, end in self.runs
                     if end - begin >= shortest]  # fmt: skip
        distance, begin, end = min(distances, default=(near + 1, 0, 0))
        if distance > near:
            raise BadInput(f"saw nobody move within {NEAR_S:g} s of that time")
        return self._with_margin(begin, end)

    def _with_margin(self, begin: int, end: int) -> tuple[int, int]:
        """Stillness compares the newest 0.2 s with those before: a movement has begun earlier."""
        margin = round(MARGIN_S * self.rate_hz)
        return max(0, begin - 2 * margin), min(self.count, end + margin)


def _moving_runs(recording: Recording, recorder: TracksRecorder) -> list[tuple[int, int]]:
    """(begin, end) of the frames in which the person moves, joined over rests shorter than SHORTEST_REST_S."""
    parts = watched_parts(recorder.body_parts)
    stillness, watched = Stillness(parts, recording.rate_hz), in_parts(recording, recorder.body_parts, parts)
    still = np.array([stillness.update(Tracks(c.astype(np.float64))) for c in watched.positions])
    visible = np.isfinite(recording.positions).any(axis=(1, 2))
    moving: NDArray[np.int64] = np.flatnonzero((still < 0.5) & visible)
    if not len(moving):
        return []
    breaks = np.flatnonzero(np.diff(moving) > SHORTEST_REST_S * recording.rate_hz)
    begins, ends = moving[np.append(0, breaks + 1)], moving[np.append(breaks, len(moving) - 1)] + 1
    return [(int(begin), int(end)) for begin, end in zip(begins, ends, strict=True)]
