"""Teaching as one observer sees it: requests in, replies out. Pure.

1. A teacher (`labanmesh teach`) asks: start, then for each take begin; the take ends when the person stands still, or
   when the teacher ends it. Then something else for some minutes, learn, and adopt, when all observers have learned.
2. A wrong verdict becomes an example, cut out of the remembered tracks. `forget` removes takes from the disk and from
   memory; the model in force knows them until a new one is adopted.
3. One teacher at a time: another is refused until the first has left, or has been silent for TEACHER_S. Anybody who may
   ask may ask for the status, and to be shown a take or what is seen now.

Times are seconds of a monotonic clock, and the times of frames in ns.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from common.errors import LabanmeshError
from common.score import LEAST_REFERENCES
from common.teaching_messages import (
    PERSON_LIMIT,
    PERSONS_LIMIT,
    SOMEONE,
    TAKES_LIMIT,
    TEACHING_TEXT_LIMIT,
    CorrectedReport,
    ForgottenReport,
    ShownTracks,
    TeachReply,
    TeachRequest,
    TeachState,
    Unwanted,
    require_person,
)
from common.vocabulary import LABEL, Vocabulary, require_teachable
from observer.motion.archive import MotionArchive, Recording
from observer.recording.own_tracks import TracksRecorder
from observer.teaching.corrections import Corrector
from observer.teaching.take_recorder import TakeRecorder, fault_line
from observer.tracks import Tracks

if TYPE_CHECKING:
    from observer.teaching.model_learner import ModelLearner
    from observer.teaching.takes_file import TakesFile

TEACHER_S = 10.0
LOOKING = ("status", "show", "earlier")
"""Commands that every teacher may send at any time."""
EARLIER = ("earlier", "restore")
DELETING = ("drop", "forget", "leave")
"""Commands that are obeyed also when takes wait in memory for space on the disk."""
NO_PICTURES_S = 2.0


class Teaching:
    """The state machine of one observer; not thread-safe. refusal: why it cannot be taught; "" if it can.

    delete_clips: deletes the clips of a label, or all for "", and returns how many.
    """

    def __init__(
        self,
        recorder: TracksRecorder,
        takes: "TakesFile",
        learner: "ModelLearner",
        refusal: str = "",
        delete_clips: Callable[[str], int] = lambda label: 0,
    ) -> None:
        self._recorder, self._takes, self._learner, self._refusal = recorder, takes, learner, refusal
        self._delete_clips = delete_clips
        self._recording, self._corrector = TakeRecorder(recorder, takes), Corrector(recorder, takes)
        self._corrected: CorrectedReport | None = None
        self._forgotten: ForgottenReport | None = None
        self._teacher, self._asked_s, self._stepped_s = "", float("-inf"), float("-inf")
        self._complaint, self._visible = "", False

    def step(self, at_ns: int, tracks: Tracks, complaint: str, now_s: float, is_of_any: bool = False) -> None:
        """Take in one frame, which the recorder has; is_of_any: the tracks may be of any of several people."""
        if is_of_any:
            self._corrector.note_several(at_ns)
        self._stepped_s, self._complaint, self._visible = now_s, complaint, bool(tracks.visible.any())
        self._recording.people.update(at_ns, tracks)
        if not self.is_taught(now_s):
            # Nobody teaches, and stillness costs time.
            self._recording.abandon()
            return
        self._recording.step(at_ns, tracks, complaint)

    def is_taught(self, now_s: float) -> bool:
        """Whether a teacher is at work."""
        return now_s - self._asked_s <= TEACHER_S

    def handle(self, request: TeachRequest, now_s: float, labels: Sequence[str]) -> TeachReply:
        """Do what is asked, if it can be done; returns the observer's state afterwards.

        labels: the movements of the model in force.
        """
        fault = self._refused(request, now_s)
        self._corrected = self._forgotten = None
        if not self._sees(now_s):
            self._recording.lose()
        if not fault:
            if request.command not in LOOKING:
                self._teacher = request.teacher
            if request.teacher == self._teacher:
                self._asked_s = now_s
            try:
                if request.command not in DELETING:
                    self._takes.write_waiting()
                fault = self._do(request, now_s)
                self._takes.write_waiting()
            except LabanmeshError as error:
                fault = fault_line(error)
        shows = request.command == "show" and (request.label or self._sees(now_s))
        tracks = self._recording.shown(request) if shows else None
        if shows and request.label and tracks is None:
            fault = f"there is no take {request.take} of {request.label}"
        reply = self._reply(fault, now_s, labels, tracks)
        return reply.model_copy(update={"earlier": self._takes.earlier}) if request.command in EARLIER else reply

    def recorded(self) -> MotionArchive | None:
        """All takes on the disk, None without any: for `check`, which takes too long for the thread of the frames."""
        return self._takes.archive

    def _refused(self, request: TeachRequest, now_s: float) -> str:
        others = request.teacher != self._teacher and now_s - self._asked_s < TEACHER_S
        if others and request.command not in LOOKING:
            return f"another `labanmesh teach` is at work with this observer; end it, or wait {TEACHER_S:g} s"
        if request.command in ("start", "correct") and self._refusal:
            return self._refusal
        if request.command in ("correct", "forget", "restore") and self._learner.busy:
            return "learns now; ask again when it has ended"
        return ""

    def _do(self, request: TeachRequest, now_s: float) -> str:
        """Do what is asked; returns why not, "" if it was done."""
        match request.command:
            case "start":
                Vocabulary(tuple(request.labels))
                self._recording.forget()
                self._learner.fault = ""
                self._takes.start(request.labels, add=request.add, lesson=request.teacher)
            case "begin":
                require_teachable(filter(None, [request.label]))
                require_person(request.person)
                return self._recording.begin(request, pictures=self._sees(now_s))
            case "end":
                self._recording.end()
            case "drop":
                current = self._recording.current
                if current is not None and current.is_asked_by(request):
                    self._recording.current = None
                self._takes.drop(request.label, str(request.take))
            case "learn" if not self._learner.busy:
                Vocabulary(tuple(request.labels))
                self._learner.learn(request.labels, self._references(request))
            case "adopt":
                if self._learner.learned is None:
                    return "no new model has been learned"
                self._learner.adopt(request.in_s)
                self._takes.finish()
            case "correct":
                require_teachable(filter(None, [request.label]))
                require_person(request.person)
                self._corrected = self._corrector.correct(request)
            case "forget":
                self._forgotten = self._forget(request)
            case "restore":
                self._recording.forget()
                self._takes.restore(request.earlier, request.teacher)
            case "leave" if request.teacher == self._teacher:
                self._recording.abandon()
                self._asked_s = float("-inf")
        return ""

    def _references(self, request: TeachRequest) -> list[str]:
        """LABEL:TRIAL of the takes that show how a movement should be done, where there are enough."""
        archive, person = self._takes.archive, request.person or SOMEONE
        kept = self._learner.references if request.add else frozenset()
        takes = {
            f"{take.label}:{take.trial}": take.label
            for take in (() if archive is None else archive.recordings)
            if (take.label in request.references and take.subject == person) or f"{take.label}:{take.trial}" in kept
        }
        counts = Counter(takes.values())
        return [words for words, label in takes.items() if counts[label] >= LEAST_REFERENCES]

    def _forget(self, request: TeachRequest) -> ForgottenReport:
        unwanted = Unwanted(request.person, request.label, request.everything)
        self._recording.forget()
        self._corrector = Corrector(self._recorder, self._takes)
        self._recorder.forget()
        models, clips, gone, faults = 0, 0, list[Recording](), []
        # What one of them cannot remove keeps nothing else.
        try:
            gone = list(self._takes.forget(unwanted))
        except LabanmeshError as error:
            faults.append(fault_line(error))
        try:
            models = self._learner.forget(unwanted, in_force=request.models or request.everything)
        except LabanmeshError as error:
            faults.append(fault_line(error))
        if request.clips:
            clips = self._delete_clips(request.label)
        if faults:
            raise LabanmeshError("; ".join(faults))
        return ForgottenReport(
            clips=clips,
            takes=sum(bool(r.label) for r in gone),
            other_s=sum(len(r.positions) / r.rate_hz for r in gone if not r.label),
            models=models,
            in_model=self._learner.knows(unwanted),
        )

    def _sees(self, now_s: float) -> bool:
        """Whether pictures arrive."""
        return now_s - self._stepped_s <= NO_PICTURES_S

    def _reply(self, fault: str, now_s: float, labels: Sequence[str], tracks: ShownTracks | None = None) -> TeachReply:
        sees = self._sees(now_s)
        complaint = self._complaint if sees else "no pictures now: is the camera working?"
        return TeachReply(
            state=self._state,
            fault=fault or (self._learner.fault if not self._learner.busy else ""),
            pictures=sees,
            visible=sees and self._visible,
            still=self._recording.stillness.probability if sees and self._visible else None,
            complaint=complaint[:TEACHING_TEXT_LIMIT],
            take=self._recording.report,
            takes={label: takes[:TAKES_LIMIT] for label, takes in self._takes.takes.items() if LABEL.match(label)},
            other_s=self._takes.other_s,
            labels=list(labels),
            learned=self._learner.learned,
            tracks=tracks,
            corrected=self._corrected,
            forgotten=self._forgotten,
            people=self._recording.people.now if sees else None,
            side=self._recording.people.side if sees else None,
            claps=self._recording.claps.count,
            persons=_sayable_persons(self._takes.persons),
        )

    @property
    def _state(self) -> TeachState:
        if self._learner.busy:
            return "learning"
        if self._recording.current is not None:
            return "recording"
        return "idle" if self._learner.learned is None else "learned"


def _sayable_persons(persons: Mapping[str, Mapping[str, int]]) -> dict[str, dict[str, int]]:
    """The persons whose names fit into a reply: a file of an earlier version may hold names of any length."""
    return {
        name: {label: count for label, count in counts.items() if not label or LABEL.match(label)}
        for name, counts in list(persons.items())[:PERSONS_LIMIT]
        if len(name) <= PERSON_LIMIT
    }
