"""Teaching as one observer sees it: requests in, replies out; takes are cut out of its own tracks. Pure.

1. A teacher (`labanmesh teach`) asks: start, then for each take begin; the take ends when the person stands still, or
   when the teacher ends it. Then something else for some minutes, learn, and adopt.
2. What cannot be used is said in the answer to the next request, and costs only that take.
3. Something else is written in pieces of PIECE_S, so that little of it is lost when the process is killed.
4. Learning takes place elsewhere (`Learner`). The new model is in force from `adopt` on, when all observers of the
   scene have learned theirs.
5. One teacher at a time: another is refused until the first has left, or has been silent for TEACHER_S; what it was
   recording ends then. Anybody who may ask may ask for the status.

Times are seconds of a monotonic clock, and the times of frames in ns.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from common import SECOND_NS
from common.errors import BadInput, LabanmeshError
from common.teaching_messages import (
    TEXT_LIMIT,
    LearnedReport,
    TakeReport,
    TakeState,
    TeachReply,
    TeachRequest,
    TeachState,
)
from common.vocabulary import Vocabulary
from observer.motion.archive import Recording
from observer.recording.own_tracks import TracksRecorder, trimmed
from observer.teaching.take_watch import StillnessStream, TakeWatch
from observer.tracks import Tracks

TEACHER_S = 10.0
PIECE_S = 20.0
SHORTEST_S = 0.4
"""No movement that a person means is shorter."""
NO_PICTURES_S = 2.0


class Learner(Protocol):
    """Learns a model in the background."""

    busy: bool
    """Whether it is learning."""
    fault: str
    """Why the last attempt failed; "" if it did not."""
    learned: LearnedReport | None
    """The model that waits to be adopted."""

    def learn(self, labels: Sequence[str]) -> None:
        """Begin to learn these movements from the takes on the disk."""

    def adopt(self, in_s: float) -> None:
        """Put the learned model in force after so many seconds."""


class Takes(Protocol):
    """The takes on the disk: `observer.teaching.takes_file.TakesFile`."""

    @property
    def takes(self) -> dict[str, list[int]]:
        """Numbers of the takes of each movement."""

    @property
    def other_s(self) -> float:
        """Seconds of something else."""

    def start(self, labels: Sequence[str], *, add: bool) -> None:
        """Begin, or go on."""

    def add(self, recording: Recording) -> None:
        """Write one more."""

    def drop(self, label: str, trial: str) -> int:
        """Remove one."""

    def write_waiting(self) -> None:
        """Write what could not be written."""

    def finish(self) -> None:
        """The takes have been learned."""


@dataclass(slots=True)
class _Recording:
    """What is recorded now. watch: of a take; None for something else, of which `piece_ns` is not written yet."""

    label: str
    take: int
    person: str
    watch: TakeWatch | None
    piece_ns: int = 0


class Teaching:
    """The state machine of one observer; not thread-safe. refusal: why it cannot be taught; "" if it can."""

    def __init__(self, recorder: TracksRecorder, takes: Takes, learner: Learner, refusal: str = "") -> None:
        self._recorder, self._takes, self._learner, self._refusal = recorder, takes, learner, refusal
        self._stream = StillnessStream(recorder.body_parts, recorder.rate_hz)
        self._teacher, self._asked_s, self._stepped_s = "", float("-inf"), float("-inf")
        self._current: _Recording | None = None
        self._last: TakeReport | None = None
        self._complaint, self._visible = "", False

    def step(self, at_ns: int, tracks: Tracks, complaint: str, now_s: float) -> None:
        """Take in one frame, which the recorder has."""
        self._stepped_s, self._complaint, self._visible = now_s, complaint, bool(tracks.visible.any())
        if now_s - self._asked_s > TEACHER_S:
            # Nobody teaches, and stillness costs time.
            self._abandon()
            return
        self._stream.update(at_ns, tracks)
        current = self._current
        if current is None:
            return
        if current.watch is None:
            if at_ns - current.piece_ns >= PIECE_S * SECOND_NS:
                self._write_piece(current, at_ns)
            return
        current.watch.update(at_ns, self._stream.probability, tracks)
        if current.watch.phase == "done":
            self._finish(current)

    def handle(self, request: TeachRequest, now_s: float, labels: Sequence[str]) -> TeachReply:
        """Do what is asked, if it can be done; the reply says how things stand then.

        labels: the movements of the model in force.
        """
        fault = self._refused(request, now_s)
        if not fault:
            if request.command != "status":
                self._teacher = request.teacher
            if request.teacher == self._teacher:
                self._asked_s = now_s
            try:
                self._takes.write_waiting()
                fault = self._do(request, now_s)
            except LabanmeshError as error:
                fault = _line(error)
        return self._reply(fault, now_s, labels)

    def _refused(self, request: TeachRequest, now_s: float) -> str:
        others = request.teacher != self._teacher and now_s - self._asked_s < TEACHER_S
        if others and request.command != "status":
            return f"another `labanmesh teach` is at work with this observer; end it, or wait {TEACHER_S:g} s"
        if request.command == "start":
            return self._refusal
        return ""

    def _do(self, request: TeachRequest, now_s: float) -> str:
        match request.command:
            case "start":
                Vocabulary(tuple(request.labels))
                self._current = self._last = None
                self._learner.fault = ""
                self._takes.start(request.labels, add=request.add)
            case "begin":
                return self._begin(request, now_s)
            case "end" if self._current is not None:
                self._end(self._current)
            case "drop":
                if self._current is not None and _is(self._current, request):
                    self._current = None
                self._takes.drop(request.label, str(request.take))
            case "learn" if not self._learner.busy:
                Vocabulary(tuple(request.labels))
                self._learner.learn(request.labels)
            case "adopt":
                if self._learner.learned is None:
                    return "no new model has been learned"
                self._learner.adopt(request.in_s)
                self._takes.finish()
            case "leave" if request.teacher == self._teacher:
                self._abandon()
                self._asked_s = float("-inf")
        return ""

    def _begin(self, request: TeachRequest, now_s: float) -> str:
        if self._current is not None:
            return "" if _is(self._current, request) else "another take is being recorded; end it first"
        newest_ns = self._recorder.newest_ns
        if newest_ns is None or now_s - self._stepped_s > NO_PICTURES_S:
            self._last = TakeReport(label=request.label, take=request.take, state="failed", fault="no pictures")
            return "no pictures now: is the camera working?"
        watch = TakeWatch(newest_ns) if request.label else None
        self._current = _Recording(request.label, request.take, request.person or "someone", watch, newest_ns)
        self._last = None
        return ""

    def _abandon(self) -> None:
        """The teacher has gone: what it was recording of something else is kept, a take is not."""
        current = self._current
        self._current = None
        if current is not None and current.watch is None and self._recorder.newest_ns is not None:
            self._write_piece(current, self._recorder.newest_ns)

    def _end(self, current: _Recording) -> None:
        if current.watch is None:
            self._current = None
            self._write_piece(current, self._recorder.newest_ns or 0)
            return
        current.watch.end()
        self._finish(current)

    def _finish(self, current: _Recording) -> None:
        """Cut the take out, write it, and keep the report for the next reply."""
        watch = current.watch
        self._current = None
        fault, seconds = "", 0.0
        if watch is not None and not (fault := watch.fault):
            seconds = watch.seconds
            try:
                seconds = self._keep(current, watch.begin_ns, watch.end_ns)
            except LabanmeshError as error:
                fault = _line(error)
        self._last = TakeReport(
            label=current.label, take=current.take, state="failed" if fault else "kept", seconds=seconds, fault=fault
        )

    def _keep(self, current: _Recording, begin_ns: int, end_ns: int) -> float:
        """Write a take without the rest before and after it; returns its length in seconds."""
        cut = self._recorder.cut(begin_ns, end_ns, label=current.label, subject=current.person, trial=str(current.take))
        take = trimmed(cut, self._recorder.body_parts)
        seconds = len(take.positions) / take.rate_hz
        if seconds < SHORTEST_S:
            raise BadInput(
                f"{seconds:.1f} s is too short for a movement: begin after the signal, and stand still after it"
            )
        self._takes.add(take)
        return seconds

    def _write_piece(self, current: _Recording, end_ns: int) -> None:
        """Write the newest piece of something else, unless nobody was seen in it."""
        begin_ns, current.piece_ns = current.piece_ns, end_ns
        fault = ""
        try:
            self._takes.add(self._recorder.cut(begin_ns, end_ns, subject=current.person))
        except BadInput:
            pass  # an empty room teaches nothing
        except LabanmeshError as error:
            fault = _line(error)
        state: TakeState = "failed" if fault else "kept"
        self._last = TakeReport(label="", take=current.take, state=state, seconds=self._takes.other_s, fault=fault)

    def _reply(self, fault: str, now_s: float, labels: Sequence[str]) -> TeachReply:
        sees = now_s - self._stepped_s <= NO_PICTURES_S
        complaint = self._complaint if sees else "no pictures now: is the camera working?"
        return TeachReply(
            state=self._state,
            fault=fault or (self._learner.fault if not self._learner.busy else ""),
            pictures=sees,
            visible=sees and self._visible,
            still=self._stream.probability if sees and self._visible else None,
            complaint=complaint[:TEXT_LIMIT],
            take=self._report(),
            takes=self._takes.takes,
            other_s=self._takes.other_s,
            labels=list(labels),
            learned=self._learner.learned,
        )

    @property
    def _state(self) -> TeachState:
        if self._learner.busy:
            return "learning"
        if self._current is not None:
            return "recording"
        return "idle" if self._learner.learned is None else "learned"

    def _report(self) -> TakeReport | None:
        current = self._current
        if current is None or current.watch is None:
            return self._last
        state: TakeState = "waiting" if current.watch.phase == "waiting" else "moving"
        return TakeReport(label=current.label, take=current.take, state=state, seconds=current.watch.seconds)


def _is(current: _Recording, request: TeachRequest) -> bool:
    return (current.label, current.take) == (request.label, request.take)


def _line(error: LabanmeshError) -> str:
    """The error for a teacher, who cannot choose another path."""
    return str(error).split(". Choose another path")[0][:TEXT_LIMIT]
