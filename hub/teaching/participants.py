"""The observers that take part in a lesson: what is asked of all of them, those that go and come back; and the sign
with which the takes of a movement begin, so that whoever performs needs no keyboard.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

from pydantic import ValidationError

from common.errors import BadInput, LabanmeshError
from common.floor_place import BODY_SPREAD_M, PERSON_GATE, FloorPlace
from common.messages import VerdictMessage
from common.teaching_messages import TaughtPlace, TeachCommand, TeachReply, TeachRequest
from hub.teaching.interface import LOOK_S, Answers, Begin, LessonInterface, Step

RETURN_S = 20.0
"""So long the lesson waits for some observer if all are away."""
BUSY, BUSY_S = "another `labanmesh teach`", 12.0
"""In the refusal of an observer that another teacher has asked lately; one that is gone is forgotten in this time."""
Ask = Callable[[TeachRequest, Collection[str]], Answers]


@dataclass(slots=True)
class Participants:
    """The observers that are taught.

    teacher: the id of this lesson's teacher. ask: sends a request to these observers. observers: those that take part
    now; taught: all that have begun. labels: the new vocabulary; add: with the takes of earlier ones. references: the
    movements of which the takes of `person` show how they should be done.
    """

    teacher: str
    interface: LessonInterface
    ask: Ask
    observers: list[str]
    add: bool = False
    references: Sequence[str] = ()
    person: str = ""
    labels: list[str] = field(default_factory=list)
    taught: list[str] = field(default_factory=list)
    faults: dict[str, str] = field(default_factory=dict)
    blind: set[str] = field(default_factory=set)
    """Observers whose cameras deliver nothing."""
    place: TaughtPlace | None = None
    """Where the one stands who is taught, as the first observer that knows it sees them."""
    by_place: bool = False
    """Whether an observer has said where; from then on all are told at each look, because people walk."""

    def request(self, command: TeachCommand, **fields: object) -> Mapping[str, TeachReply]:
        """Ask all participants. An observer that does not answer is left out until it answers again.

        Raises LabanmeshError if none answers for RETURN_S.
        """
        if command == "begin":
            self.look()
        where = {"place": self.place} if command in ("status", "begin") else {}
        answers = self.ask(self._made(command, **fields, **where), self.observers)
        self._note_places(answers)
        for name in answers.silent:
            self.interface.say(f"{name}: no answer any more; the others go on")
        for name, fault in answers.faults.items():
            # Once, and not at every look.
            if self.faults.get(name) != fault:
                self.interface.say(f"{name}: {fault}")
        self.faults = answers.faults
        self._tell_of_pictures(answers)
        self.observers = [name for name in self.observers if name not in answers.silent]
        if not self.observers:
            self._wait_for_return()
            return self.request(command, **fields)
        return answers.replies

    def _note_places(self, answers: Answers) -> None:
        """Take in where the one stands who is taught; say it once when no observer is sure who that is."""
        known = self.place is not None
        self.place = next((reply.place for reply in answers.replies.values() if reply.place is not None), None)
        self.by_place |= self.place is not None
        if known and self.place is None:
            lines = (f"{name}: {reply.complaint}" for name, reply in answers.replies.items() if reply.complaint)
            for line in lines:
                self.interface.say(line)

    def look(self) -> None:
        """Ask where the one is who is taught, where cameras tell people apart."""
        if self.by_place:
            self.request("status")

    def is_of_taught(self, verdict: VerdictMessage) -> bool:
        """Whether a verdict is of the one who is taught, by where that person is; of anybody where that is unknown."""
        if self.place is None or verdict.place is None:
            return True
        x, z = verdict.place
        there = FloorPlace(at=(x, z), covariance=(BODY_SPREAD_M**2, 0.0, BODY_SPREAD_M**2))
        return self.place.on_floor().distance(there) <= PERSON_GATE / 2

    def _tell_of_pictures(self, answers: Answers) -> None:
        """Say it once when a camera is lost, and when it is back."""
        for name, reply in answers.replies.items():
            if self.taught and not reply.pictures and name not in self.blind:
                self.interface.say(f"{name}: {reply.complaint or 'no pictures now: is the camera working?'}")
                self.blind.add(name)
            elif reply.pictures and name in self.blind:
                self.interface.say(f"{name}: has pictures again")
                self.blind.discard(name)

    def check(self) -> Mapping[str, TeachReply]:
        """The replies of observers that can name contradicting takes."""
        replies = self.ask(self._made("check", labels=self.labels), self.observers).replies
        return {name: reply for name, reply in replies.items() if not reply.fault}

    def request_of(self, command: TeachCommand, observers: Collection[str], **fields: object) -> Answers:
        """Ask only these observers; returns their answers, also those that report a fault."""
        return self.ask(self._made(command, **fields), observers)

    def start(self, labels: list[str]) -> Mapping[str, TeachReply]:
        """Start teaching this vocabulary; returns the replies of the observers that can be taught.

        Raises LabanmeshError if none can.
        """
        self.labels = labels
        begun_s = self.interface.now_s()
        started = self.request("start", labels=labels, add=self.add)
        # A teacher that was killed counts as gone after some seconds.
        while any(BUSY in reply.fault for reply in started.values()) and self.interface.now_s() - begun_s < BUSY_S:
            self.interface.pause(1.0)
            started = self.request("start", labels=labels, add=self.add)
        self.observers = [name for name, reply in started.items() if not reply.fault]
        if not self.observers:
            raise LabanmeshError("no observer can be taught now; the lines above say why")
        self.taught = list(self.observers)
        return {name: started[name] for name in self.observers}

    def take_back(self) -> None:
        """Readmit observers that answer again."""
        away = [name for name in self.taught if name not in self.observers]
        if away:
            again = self._made("start", labels=self.labels, add=self.add)
            for name, reply in self.ask(again, away).replies.items():
                if not reply.fault:
                    self.interface.say(f"{name}: is back")
                    self.observers.append(name)

    def _made(self, command: TeachCommand, **fields: object) -> TeachRequest:
        try:
            return TeachRequest(command=command, teacher=self.teacher, **fields)  # type: ignore[arg-type]
        except ValidationError as error:
            fault = error.errors()[0]
            raise BadInput(f"{command}: {fault['loc'][0]} = {str(fault['input'])[:64]!r}: {fault['msg']}") from None

    def _wait_for_return(self) -> None:
        """Wait until an observer answers again, as after a restart by `labanmesh up`."""
        begun_s = self.interface.now_s()
        while self.taught and self.interface.now_s() - begun_s < RETURN_S:
            self.interface.pause(1.0)
            self.take_back()
            if self.observers:
                return
        raise LabanmeshError("no observer answers any more; what was recorded is kept: the same command goes on")


STANDS_S = 1.2
"""Somebody who has stood still for so long, in the sight of one observer, is ready."""
RESTLESS_S = 30.0
"""After so long in sight the lesson begins with somebody who never stands still, as in a film."""
NOBODY_CAME_S = 180.0
HINTS = {
    "key": "press a key to begin",
    "clap": "clap your hands once, in front of you, to begin; or press a key",
    "still": "stand still to begin; or press a key",
}
NOBODY = "nobody came into the sight of a camera in {:.0f} minutes; the same command goes on where this one stops"


def wait_for_sign(how: Begin, participants: Participants, step: Step) -> None:
    """Wait until the takes of a movement may begin; raises LabanmeshError if nobody comes for NOBODY_CAME_S.

    step: the movement, for the screen.
    """
    if how == "now":
        return
    interface = participants.interface
    interface.say(f"{step.label}: {HINTS[how]}")
    seen_s = sighted_s = interface.now_s()
    sign = SIGNS[how]() if how in SIGNS else None
    while interface.now_s() - seen_s < NOBODY_CAME_S:
        interface.show(step)
        if interface.between(step, LOOK_S).kind == "begin":
            return
        replies = participants.request("status")
        if any(reply.visible for reply in replies.values()):
            seen_s = interface.now_s()
            if how == "still" and seen_s - sighted_s > RESTLESS_S:
                interface.say("nobody stands still; it begins all the same")
                return
        else:
            sighted_s = interface.now_s()
        if sign is not None and sign.is_given(replies, interface.now_s()):
            return
    raise LabanmeshError(NOBODY.format(NOBODY_CAME_S / 60))


class Clap:
    """Whether somebody has clapped since the first look, as one observer saw."""

    def __init__(self) -> None:
        self._before: dict[str, int] = {}

    def is_given(self, replies: Mapping[str, TeachReply], now_s: float) -> bool:
        """Whether an observer counts more claps than before; one that was started again counts anew."""
        clapped = any(reply.claps > self._before.get(name, reply.claps) for name, reply in replies.items())
        self._before |= {name: reply.claps for name, reply in replies.items()}
        return clapped


class Still:
    """Somebody stands still for STANDS_S."""

    def __init__(self) -> None:
        self._since_s: dict[str, float] = {}

    def is_given(self, replies: Mapping[str, TeachReply], now_s: float) -> bool:
        """Whether one observer has seen somebody stand still all the time."""
        still = {name for name, reply in replies.items() if reply.visible and (reply.still or 0.0) >= 0.5}
        self._since_s = {name: self._since_s.get(name, now_s) for name in still}
        return any(now_s - since_s >= STANDS_S for since_s in self._since_s.values())


SIGNS: Mapping[Begin, type[Clap | Still]] = {"clap": Clap, "still": Still}
"""What is looked for in the replies of the observers, look by look; a key is no reply."""
