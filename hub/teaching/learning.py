"""The second half of a lesson: all observers learn, change together, and are tested. Pure."""

from collections.abc import Callable, Mapping, Sequence

from common.errors import LabanmeshError
from common.messages import VerdictMessage
from common.teaching_messages import LearnedReport, TeachReply
from common.text import plural
from common.vocabulary import ABSTAIN
from hub.teaching.interface import LOOK_S, LessonInterface, Step
from hub.teaching.participants import Participants
from hub.teaching.wording import (
    outcome_line,
    reference_lines,
    result_lines,
    summary_line,
)

LEARN_LIMIT_S = 900.0
ADOPT_IN_S = 0.7
FOLLOW_S = 10.0


def learn(participants: Participants) -> dict[str, LearnedReport]:
    """What each observer has learned; one that cannot is left out. Raises LabanmeshError if too few can."""
    interface = participants.interface
    participants.take_back()
    others = _leave_out_those_without_takes(participants)
    participants.request("learn", **_wanted(participants))
    begun_s, learned, replies = interface.now_s(), dict[str, LearnedReport](), dict[str, TeachReply]()
    while len(learned) < len(participants.observers) and interface.now_s() - begun_s < LEARN_LIMIT_S:
        count, seconds = len(participants.observers), interface.now_s() - begun_s
        interface.show(Step("learning", number=len(learned), of=count, left_s=seconds))
        interface.pause(LOOK_S)
        replies = dict(participants.request("status"))
        learned |= {name: reply.learned for name, reply in replies.items() if reply.learned is not None}
        _learn_again(participants, replies)
    others += sum(bool(replies[name].labels) for name in replies if name not in learned)
    if len(learned) <= others:
        raise LabanmeshError("most observers could not learn; nothing changes, and the takes are kept")
    for line in (*result_lines(learned), *reference_lines(learned, participants.references)):
        interface.say(line)
    return learned


def _wanted(participants: Participants) -> dict[str, object]:
    references = {"references": list(participants.references), "person": participants.person}
    return {"labels": participants.labels, "add": participants.add, **references}


def adopt(participants: Participants, learned: Mapping[str, LearnedReport]) -> None:
    """Let all observers change together; then the fusion service follows. Raises LabanmeshError if it does not."""
    interface = participants.interface
    interface.show(Step("adopting"))
    participants.observers = [name for name in participants.observers if name in learned]
    participants.request("adopt", in_s=ADOPT_IN_S)
    begun_s = interface.now_s()
    while interface.now_s() - begun_s < FOLLOW_S:
        interface.pause(LOOK_S)
        late = [name for name, reply in participants.request("status").items() if reply.learned is not None]
        if late:
            participants.request_of("adopt", late)
        if list(interface.fused_labels()) == participants.labels:
            count, labels = plural(len(participants.observers), "observer"), ", ".join(participants.labels)
            interface.say(f"{count} and the fusion service recognise {labels} from now on")
            return
    raise LabanmeshError("the observers have new models; the fusion service has not followed: is it running?")


def _leave_out_those_without_takes(participants: Participants) -> int:
    """How many of those that are left out publish; the fusion service follows more than half of all that do."""
    replies = participants.request("status")
    wanted = participants.labels
    lacks = {name: [each for each in wanted if not reply.takes.get(each)] for name, reply in replies.items()}
    missing = {name: ", ".join(labels) for name, labels in lacks.items() if labels}
    for name, labels in missing.items():
        line = f"{name}: has no take of {labels}, and cannot learn; it goes on with its old model"
        participants.interface.say(line)
    participants.observers = [name for name in participants.observers if name not in missing]
    others = sum(bool(replies[name].pictures and replies[name].labels) for name in missing)
    if len(participants.observers) <= others:
        raise LabanmeshError("too few observers have takes of all movements; nothing changes, and takes are kept")
    return others


def _learn_again(participants: Participants, replies: Mapping[str, TeachReply]) -> None:
    """Leave out the observers that could not learn; one that was started again meanwhile learns again."""
    idle = [name for name in participants.observers if replies[name].state == "idle"]
    restarted = [name for name in idle if not replies[name].fault]
    if restarted:
        participants.request_of("learn", restarted, **_wanted(participants))
    participants.observers = [name for name in participants.observers if name not in idle or name in restarted]


TEST_LIMIT_S = 8.0


def self_test(
    labels: Sequence[str],
    interface: LessonInterface,
    count_down: Callable[[Step], None],
    alarm_s: float = 0.0,
    learned: Mapping[str, LearnedReport] | None = None,
    participants: Participants | None = None,
) -> None:
    """Ask for each movement once, then count false alarms for `alarm_s`. count_down: counts down to `now` of a step.

    learned: how the observers did on takes that they had left out. participants: of the lesson; verdicts of
    others than the one who is taught do not count.
    """
    interface.say("now do each movement once more, and see what the fusion service says")
    right: dict[str, bool] = {}
    for label in labels:
        interface.pause(2.0)
        count_down(Step("now", label, is_test=True))
        decided = next_verdict(interface, participants)
        right[label] = decided == label
        interface.show(Step("kept" if right[label] else "failed", label, is_test=True))
        interface.say(outcome_line(label, decided))
    alarms, lasted_s = _false_alarms(interface, alarm_s, participants) if alarm_s else (0, 0.0)
    interface.say(summary_line(right, alarms, lasted_s, learned or {}))


def next_verdict(interface: LessonInterface, participants: Participants | None = None) -> str:
    """The label of the first verdict on the one who is taught within TEST_LIMIT_S; "" if there is none."""
    interface.verdicts()
    begun_s, decided = interface.now_s(), ""
    while not decided and interface.now_s() - begun_s < TEST_LIMIT_S:
        interface.pause(LOOK_S)
        decided = next((each.label for each in _own_verdicts(interface, participants)), "")
    return decided


def _own_verdicts(interface: LessonInterface, participants: Participants | None) -> list[VerdictMessage]:
    """What was decided since the last call about the one who is taught, or about anybody where that is not known."""
    if participants is None:
        return [*interface.verdicts()]
    participants.look()
    return [verdict for verdict in interface.verdicts() if participants.is_of_taught(verdict)]


def _false_alarms(interface: LessonInterface, alarm_s: float, participants: Participants | None) -> tuple[int, float]:
    """The number of verdicts that named a movement while nobody did one, and the seconds watched."""
    interface.say(
        f"now {alarm_s / 60:.1f} minutes of anything but the movements: each verdict is a false alarm (s: skip)"
    )
    interface.pause(2.0)
    interface.verdicts()
    begun_s, alarms = interface.now_s(), 0
    while (left_s := begun_s + alarm_s - interface.now_s()) > 0:
        step = Step("alarms", number=alarms, left_s=left_s)
        interface.show(step)
        if interface.between(step, min(1.0, left_s)).kind == "skip":
            break
        for verdict in _own_verdicts(interface, participants):
            if verdict.label != ABSTAIN:
                alarms += 1
                interface.say(f"false alarm: {verdict.label}")
    return alarms, interface.now_s() - begun_s
