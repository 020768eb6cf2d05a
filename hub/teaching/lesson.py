"""One lesson, from the first look at the observers to their new models. Clock, keyboard and mesh are passed in."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

from common.errors import LabanmeshError
from common.teaching_messages import LearnedReport, TeachCommand, TeachReply, TeachRequest
from hub.teaching.room import Answers, Room
from hub.teaching.wording import (
    adopted_line,
    has_kept,
    missing_line,
    outcome_line,
    presence_line,
    result_lines,
    take_lines,
    takes_done,
    vocabulary_of,
    without_takes,
)

LOOK_S = 0.2
TAKE_LIMIT_S = 25.0
"""An observer ends a take by itself; one without pictures does not."""
FAILURES_LIMIT = 3
"""After so many takes in a row that nobody kept, the lesson ends: somebody must look after it."""
LEARN_LIMIT_S = 900.0
RETURN_S = 20.0
"""So long the lesson waits for some observer if all are away."""
ADOPT_IN_S = 0.7
FOLLOW_S = 10.0
TEST_LIMIT_S = 8.0
REPEAT, DROP = "r", "d"


@dataclass(frozen=True, slots=True)
class LessonPlan:
    """takes: of each movement. seconds: of a take; None: until the person stands still. countdown: from where.

    test: whether each movement is done once more at the end, for the fusion service.
    """

    labels: Sequence[str]
    teacher: str
    person: str = "someone"
    takes: int = 5
    background_s: float = 120.0
    seconds: float | None = None
    countdown: int = 3
    add: bool = False
    test: bool = False


@dataclass(slots=True)
class Lesson:
    """Teaches the observers; ask: sends a request to all of these observers."""

    plan: LessonPlan
    room: Room
    ask: Callable[[TeachRequest, Collection[str]], Answers]
    observers: list[str]
    labels: list[str] = field(default_factory=list)
    taught: list[str] = field(default_factory=list)
    faults: dict[str, str] = field(default_factory=dict)

    def run(self) -> None:
        """The whole lesson; raises LabanmeshError, one line, if it cannot go on. Takes that were made are kept."""
        asked = list(self.observers)
        try:
            replies = self._begin()
            for label in self.plan.labels:
                done = takes_done(label, replies)
                # Of a movement that the models know, --add means more takes.
                known = self.plan.add and any(label in reply.labels for reply in replies.values())
                self._takes_of(label, done, self.plan.takes + (len(done) if known else 0))
            self._something_else()
            self._adopt(self._learn())
            if self.plan.test:
                self._test()
        finally:
            self.ask(TeachRequest(command="leave", teacher=self.plan.teacher), asked)

    def _request(self, command: TeachCommand, **fields: object) -> Mapping[str, TeachReply]:
        request = TeachRequest(command=command, teacher=self.plan.teacher, **fields)  # type: ignore[arg-type]
        answers = self.ask(request, self.observers)
        for name in answers.silent:
            self.room.say(f"{name}: no answer any more; the others go on")
        for name, fault in answers.faults.items():
            # Once, and not at every look.
            if self.faults.get(name) != fault:
                self.room.say(f"{name}: {fault}")
        self.faults = answers.faults
        self.observers = [name for name in self.observers if name not in answers.silent]
        if not self.observers:
            self._wait_for_return()
            return self._request(command, **fields)
        return answers.replies

    def _wait_for_return(self) -> None:
        """No observer answers: one that is started again, as `labanmesh up` does, goes on."""
        begun_s = self.room.now_s()
        while self.taught and self.room.now_s() - begun_s < RETURN_S:
            self.room.pause(1.0)
            self._take_back()
            if self.observers:
                return
        raise LabanmeshError("no observer answers any more; what was recorded is kept: the same command goes on")

    def _take_back(self) -> None:
        """Observers that were away, and answer again, go on with the others."""
        away = [name for name in self.taught if name not in self.observers]
        if away:
            again = TeachRequest(command="start", teacher=self.plan.teacher, labels=self.labels, add=self.plan.add)
            for name, reply in self.ask(again, away).replies.items():
                if not reply.fault:
                    self.room.say(f"{name}: is back")
                    self.observers.append(name)

    def _begin(self) -> Mapping[str, TeachReply]:
        first = self._request("status")
        for name, reply in first.items():
            self.room.say(presence_line(name, reply))
        self.labels = vocabulary_of(self.plan.labels, first, add=self.plan.add)
        started = self._request("start", labels=self.labels, add=self.plan.add)
        self.observers = [name for name, reply in started.items() if not reply.fault]
        if not self.observers:
            raise LabanmeshError("no observer can be taught now; the lines above say why")
        self.taught = list(self.observers)
        return {name: started[name] for name in self.observers}

    def _takes_of(self, label: str, done: set[int], wanted: int) -> None:
        """All takes of a movement that are not on a disk yet."""
        if done:
            self.room.say(f"{label}: goes on after {len(done)} takes")
        number, failures = max(done, default=0), 0
        while len(done) < wanted:
            number += 1
            replies = self._take(label, number, f"{label} {len(done) + 1} of {wanted}")
            if not has_kept(replies):
                failures += 1
                if failures == FAILURES_LIMIT:
                    raise LabanmeshError(
                        f"{label}: {failures} takes in a row that no observer could keep; "
                        "the same command goes on where this one stops"
                    )
                continue
            failures = 0
            key = self.room.key(self._between_s)
            if key in (REPEAT, DROP):
                self._request("drop", label=label, take=number)
                self.room.say("dropped" if key == DROP else "again")
            if key != REPEAT:
                done.add(number)

    @property
    def _between_s(self) -> float:
        return 1.5 if self.plan.countdown else 0.0

    def _count_down(self, title: str) -> None:
        for left in range(self.plan.countdown, 0, -1):
            self.room.show(f"{title}: {left}")
            self.room.pause(1.0)
        self.room.show(f"{title}: now\a")

    def _take(self, label: str, number: int, title: str) -> Mapping[str, TeachReply]:
        self._take_back()
        self._count_down(title)
        self._request("begin", label=label, take=number, person=self.plan.person)
        limit_s = TAKE_LIMIT_S if self.plan.seconds is None else self.plan.seconds
        begun_s = self.room.now_s()
        while self.room.now_s() - begun_s < limit_s:
            self.room.pause(LOOK_S)
            replies = self._request("status")
            if not any(reply.state == "recording" for reply in replies.values()):
                break
        else:
            replies = self._request("end")
        for n, line in enumerate(take_lines(replies)):
            self.room.say(f"{title}: {line}" if n == 0 else f"  {line}")
        return replies

    def _something_else(self) -> None:
        """Some minutes of ordinary life, less what is on the disks already."""
        wanted_s = self.plan.background_s
        replies = self._request("status")
        left_s = wanted_s - max((reply.other_s for reply in replies.values()), default=0.0)
        if left_s < 1:
            return
        self.room.say(
            f"now {left_s / 60:.1f} minutes of something else: sit, walk through, reach for things, scratch your head; "
            "none of the movements"
        )
        self._request("begin", label="", take=1, person=self.plan.person)
        end_s = self.room.now_s() + left_s
        while (rest_s := end_s - self.room.now_s()) > 0:
            self.room.show(f"something else: {rest_s:.0f} s to go")
            self.room.pause(min(1.0, rest_s))
            self._request("status")
        kept = self._request("end")
        self.room.say("something else: " + ", ".join(f"{name} {r.other_s:.0f} s" for name, r in kept.items()))

    def _learn(self) -> dict[str, LearnedReport]:
        """What each observer has learned; one that cannot is left out."""
        self._take_back()
        replies = self._request("status")
        missing = without_takes(self.labels, replies)
        for name, labels in missing.items():
            self.room.say(missing_line(name, labels))
        self.observers = [name for name in self.observers if name not in missing]
        # The fusion service follows more than half of those that publish.
        others = sum(bool(replies[name].pictures and replies[name].labels) for name in missing)
        if len(self.observers) <= others:
            raise LabanmeshError("too few observers have takes of all movements; nothing changes, and takes are kept")
        self._request("learn", labels=self.labels)
        begun_s, learned, replies = self.room.now_s(), dict[str, LearnedReport](), {}
        while len(learned) < len(self.observers) and self.room.now_s() - begun_s < LEARN_LIMIT_S:
            self.room.show(f"learning: {len(learned)} of {len(self.observers)}, {self.room.now_s() - begun_s:.0f} s")
            self.room.pause(LOOK_S)
            replies = self._request("status")
            learned |= {name: reply.learned for name, reply in replies.items() if reply.learned is not None}
            self._learn_again(replies)
        others += sum(bool(replies[name].labels) for name in replies if name not in learned)
        if len(learned) <= others:
            raise LabanmeshError("most observers could not learn; nothing changes, and the takes are kept")
        for line in result_lines(learned):
            self.room.say(line)
        return learned

    def _learn_again(self, replies: Mapping[str, TeachReply]) -> None:
        """Leave out the observers that could not learn; one that was started again meanwhile learns again."""
        idle = [name for name in self.observers if replies[name].state == "idle"]
        restarted = [name for name in idle if not replies[name].fault]
        if restarted:
            self.ask(TeachRequest(command="learn", teacher=self.plan.teacher, labels=self.labels), restarted)
        self.observers = [name for name in self.observers if name not in idle or name in restarted]

    def _adopt(self, learned: Mapping[str, LearnedReport]) -> None:
        """All change together; then the fusion service follows."""
        self.observers = [name for name in self.observers if name in learned]
        self._request("adopt", in_s=ADOPT_IN_S)
        begun_s = self.room.now_s()
        while self.room.now_s() - begun_s < FOLLOW_S:
            self.room.pause(LOOK_S)
            late = [name for name, reply in self._request("status").items() if reply.learned is not None]
            if late:
                self.ask(TeachRequest(command="adopt", teacher=self.plan.teacher), late)
            if list(self.room.fused_labels()) == self.labels:
                self.room.say(adopted_line(len(self.observers), self.labels))
                return
        raise LabanmeshError("the observers have new models; the fusion service has not followed: is it running?")

    def _test(self) -> None:
        """Each movement once more: what the fusion service says."""
        self.room.say("now do each movement once more, and see what the fusion service says")
        right = 0
        for label in self.plan.labels:
            self.room.pause(2.0)
            self._count_down(f"test: {label}")
            self.room.verdicts()
            begun_s, decided = self.room.now_s(), ""
            while not decided and self.room.now_s() - begun_s < TEST_LIMIT_S:
                self.room.pause(LOOK_S)
                decided = next(iter(self.room.verdicts()), "")
            right += decided == label
            self.room.say(outcome_line(label, decided))
        self.room.say(f"{right} of {len(self.plan.labels)} recognised")
