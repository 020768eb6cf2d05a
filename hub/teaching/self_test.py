"""The test at the end of a lesson: the verdicts on each movement, done once more, and on something else."""

from collections.abc import Callable, Mapping, Sequence

from common.messages import VerdictMessage
from common.teaching_messages import LearnedReport
from common.vocabulary import ABSTAIN
from hub.teaching.interface import LOOK_S, LessonInterface, Step
from hub.teaching.participants import Participants
from hub.teaching.wording import outcome_line, summary_line

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
