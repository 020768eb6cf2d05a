"""One lesson, from the first look at the observers to their new models. Clock, keys and mesh are passed in.

1. `Lesson.run` is the same for the terminal and for the dashboard's page: they differ in their `LessonInterface`.
2. A take that no observer could keep is asked for again; whatever was kept lies on the observers' disks, so that a
   lesson that ends anywhere goes on with the same movements.
3. Where a person may want to look or rest (`LessonInterface.ready`) a page waits, and a terminal does not.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from common.errors import LabanmeshError
from common.teaching_messages import SOMEONE, TeachReply, TeachRequest
from common.text import plural
from hub.teaching.interface import GO, LOOK_S, Action, Begin, LessonInterface, Step
from hub.teaching.learning import adopt, learn, self_test
from hub.teaching.participants import Ask, Participants, wait_for_sign
from hub.teaching.wording import (
    crowd_lines,
    doubt_lines,
    doubted_by_all,
    has_kept,
    place_of,
    placeless,
    presence_line,
    take_lines,
    takes_done,
    vocabulary_of,
)

BETWEEN_S, OFFER_S = 1.5, 6.0
"""Seconds in which a take can be repeated or dropped: any take, and one that is doubtful."""
TAKE_LIMIT_S = 25.0
"""An observer ends a take by itself; one without pictures does not."""
FAILURES_LIMIT = 3
"""After so many takes in a row that nobody kept, the lesson ends: somebody must look after it."""


@dataclass(frozen=True, slots=True)
class LessonPlan:
    """takes: of each movement. seconds: of a take; None: until the person stands still. countdown: from where.

    test: whether each movement is done once more at the end, for the fusion service; alarm_s: and then so long
    something else, in which verdicts are false alarms. begin: the sign with which the takes of a movement begin.
    reference: whether the takes show how the movements should be done.
    """

    labels: Sequence[str]
    teacher: str
    person: str = SOMEONE
    takes: int = 5
    background_s: float = 120.0
    seconds: float | None = None
    countdown: int = 3
    add: bool = False
    test: bool = False
    alarm_s: float = 0.0
    begin: Begin = "now"
    reference: bool = False


class Lesson:
    """Teaches the observers; ask: sends a request to all of these observers."""

    def __init__(self, plan: LessonPlan, interface: LessonInterface, ask: Ask, observers: Collection[str]) -> None:
        self._plan, self._interface, self._asked = plan, interface, list(observers)
        self._crowds: set[str] = set()
        references = plan.labels if plan.reference else ()
        self._participants = Participants(
            plan.teacher, interface, ask, list(observers), plan.add, references, plan.person
        )

    def run(self) -> None:
        """Hold the whole lesson; raises LabanmeshError, one line, if it cannot go on. Takes that were made are kept."""
        plan, interface, participants = self._plan, self._interface, self._participants
        try:
            replies = self._begin()
            for label in plan.labels:
                done = takes_done(label, replies)
                # Of a movement that the models know, --add means more takes.
                known = plan.add and any(label in reply.labels for reply in replies.values())
                self._takes_of(label, done, plan.takes + (len(done) if known else 0))
            self._contradictions()
            self._something_else()
            learned = learn(participants)
            if interface.ready(Step("learned")).kind == "skip":
                interface.say("nothing has changed; the takes are kept")
                return
            adopt(participants, learned)
            if plan.test and interface.ready(Step("test")).kind != "skip":
                self_test(plan.labels, interface, self._count_down, plan.alarm_s, learned, participants)
        finally:
            participants.ask(TeachRequest(command="leave", teacher=plan.teacher), self._asked)

    def _begin(self) -> Mapping[str, TeachReply]:
        first = self._participants.request("status")
        if any(reply.side is not None for reply in first.values()):
            # By now those that were asked know where people stand, and then whom the first of them teaches.
            for _ in range(2):
                self._interface.pause(LOOK_S)
                first = self._participants.request("status")
        for name, reply in first.items():
            self._interface.say(presence_line(name, reply))
        for name in placeless(first):
            self._interface.say(f"{name}: does not know where people stand: nobody else may be in view while it learns")
        return self._participants.start(vocabulary_of(self._plan.labels, first, add=self._plan.add))

    def _takes_of(self, label: str, done: set[int], wanted: int) -> None:
        """All takes of a movement that are not on a disk yet, until the person is content with them."""
        if done:
            self._interface.say(f"{label}: goes on after {plural(len(done), 'take')}")
        newest, action = max(done, default=0), GO
        if len(done) < wanted:
            action = self._interface.ready(Step("ready", label, len(done), wanted))
        if action.kind != "skip" and len(done) < wanted:
            how = self._plan.begin
            wait_for_sign(how, self._participants, Step("waiting", label, len(done) + 1, wanted, how=how))
        while action.kind != "skip":
            if action.kind == "drop":
                self._drop(label, action.take, done)
            else:
                newest = self._record(label, newest, done, max(wanted, len(done) + (action.kind == "more")))
            action = self._interface.ready(Step("review", label, len(done), wanted))
            if action.kind == "go":
                return

    def _record(self, label: str, newest: int, done: set[int], wanted: int) -> int:
        """Takes until there are as many as wanted; the number of the newest."""
        failures, made = 0, len(done)
        while made < wanted:
            newest += 1
            step = Step("now", label, made + 1, wanted)
            replies = self._take(step, newest)
            is_kept = has_kept(replies)
            self._interface.show(replace(step, kind="kept" if is_kept else "failed"))
            failures = 0 if is_kept else failures + 1
            if failures == FAILURES_LIMIT:
                raise LabanmeshError(
                    f"{label}: {failures} takes in a row that no observer could keep; "
                    "the same command goes on where this one stops"
                )
            if is_kept:
                made += 1
                done.add(newest)
            action = self._after_take(step, replies)
            if action.kind in ("drop", "repeat"):
                dropped = self._drop(label, action.take or newest, done)
                made -= dropped and action.kind == "repeat"
                self._interface.say("again" if action.kind == "repeat" else "dropped")
            elif action.kind == "pause":
                self._interface.ready(Step("ready", label, made, wanted))
        return newest

    def _after_take(self, step: Step, replies: Mapping[str, TeachReply]) -> Action:
        """What is pressed then; there is more time if somebody else was in the picture."""
        # Once is enough where somebody else always sits in the picture.
        crowd = [line for line in crowd_lines(replies) if has_kept(replies) and line not in self._crowds]
        for line in crowd:
            self._interface.say(line)
            self._crowds.add(line)
        pause_s = BETWEEN_S if self._plan.countdown else 0.0
        return self._between(replace(step, kind="between"), OFFER_S if crowd else pause_s)

    def _between(self, step: Step | None, seconds: float) -> Action:
        """What is pressed within so many seconds; None: nothing can be. Where cameras tell people apart, they are told
        meanwhile where the one stands whom they teach: one of them may lose sight of whom another one sees."""
        interface, action = self._interface, GO
        end_s = interface.now_s() + seconds
        while True:
            left_s = end_s - interface.now_s()
            part_s = min(left_s, LOOK_S) if self._participants.by_place else left_s
            if step is None:
                interface.pause(part_s)
            elif (action := interface.between(step, part_s)).kind != "go":
                return action
            if part_s >= left_s:
                return GO
            self._participants.look()

    def _contradictions(self) -> None:
        """Say which takes look like those of another movement, and offer to repeat those that do so from everywhere."""
        answers = self._participants.check()
        for line in doubt_lines(answers):
            self._interface.say(line)
        for label, take in doubted_by_all(answers):
            step = Step("doubt", label, take)
            self._interface.show(replace(step, number=place_of(label, take, answers)))
            if self._interface.between(step, OFFER_S).kind == "repeat":
                done = takes_done(label, answers)
                self._drop(label, take, done)
                self._record(label, max((*done, take)), done, len(done) + 1)

    def _drop(self, label: str, take: int, done: set[int]) -> bool:
        if take not in done:
            return False
        self._participants.request("drop", label=label, take=take)
        done.discard(take)
        return True

    def _count_down(self, step: Step, begin: Callable[[], object] = lambda: None) -> None:
        """Count down, `begin`, and only then say `now`: a person reacts in 0.2 s, and a busy machine may be slower."""
        for left in range(self._plan.countdown, 0, -1):
            self._interface.show(replace(step, kind="countdown", left_s=left))
            self._between(None, 1.0)
        begin()
        self._interface.show(step)

    def _take(self, step: Step, number: int) -> Mapping[str, TeachReply]:
        plan, interface, participants = self._plan, self._interface, self._participants
        participants.take_back()
        begun = {"label": step.label, "take": number, "person": plan.person}
        self._count_down(step, lambda: participants.request("begin", **begun))
        limit_s = TAKE_LIMIT_S if plan.seconds is None else plan.seconds
        begun_s = interface.now_s()
        while interface.now_s() - begun_s < limit_s:
            interface.pause(LOOK_S)
            replies = participants.request("status")
            if not any(reply.state == "recording" for reply in replies.values()):
                break
        else:
            replies = participants.request("end")
        for n, line in enumerate(take_lines(replies)):
            interface.say(f"{step.label} {step.number} of {step.of}: {line}" if n == 0 else f"  {line}")
        return replies

    def _something_else(self) -> None:
        """Some minutes of ordinary life, less what is on the disks already."""
        interface, participants = self._interface, self._participants
        replies = participants.request("status")
        left_s = self._plan.background_s - max((reply.other_s for reply in replies.values()), default=0.0)
        if left_s < 1 or interface.ready(Step("ready", left_s=left_s)).kind == "skip":
            return
        interface.say(
            f"now {left_s / 60:.1f} minutes of something else: sit, walk through, reach for things, scratch your head; "
            "none of the movements"
        )
        participants.request("begin", label="", take=1, person=self._plan.person)
        end_s = interface.now_s() + left_s
        while (rest_s := end_s - interface.now_s()) > 0:
            step = Step("other", of=round(left_s), left_s=rest_s)
            interface.show(step)
            if self._between(step, min(1.0, rest_s)).kind == "skip":
                break
            participants.request("status")
        ended = participants.request("end")
        interface.say("something else: " + ", ".join(f"{name} {r.other_s:.0f} s" for name, r in ended.items()))
