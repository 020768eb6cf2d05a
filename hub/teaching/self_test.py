"""The end of a lesson: each movement once more, and something else; what the fusion service says to it."""

from collections.abc import Callable, Mapping, Sequence

from common.teaching_messages import LearnedReport
from common.vocabulary import ABSTAIN
from hub.teaching.room import Room, Step
from hub.teaching.wording import outcome_line, summary_line

LOOK_S = 0.2
TEST_LIMIT_S = 8.0


def self_test(
    labels: Sequence[str],
    room: Room,
    count_down: Callable[[Step], None],
    alarm_s: float = 0.0,
    learned: Mapping[str, LearnedReport] | None = None,
) -> None:
    """Ask for each movement once, then count false alarms for `alarm_s`. count_down: counts down to `now` of a step.

    learned: how the observers did on takes that they had left out.
    """
    room.say("now do each movement once more, and see what the fusion service says")
    right: dict[str, bool] = {}
    for label in labels:
        room.pause(2.0)
        count_down(Step("now", label, is_test=True))
        room.verdicts()
        begun_s, decided = room.now_s(), ""
        while not decided and room.now_s() - begun_s < TEST_LIMIT_S:
            room.pause(LOOK_S)
            decided = next(iter(room.verdicts()), "")
        right[label] = decided == label
        room.show(Step("kept" if right[label] else "failed", label, is_test=True))
        room.say(outcome_line(label, decided))
    alarms, lasted_s = _false_alarms(room, alarm_s) if alarm_s else (0, 0.0)
    room.say(summary_line(right, alarms, lasted_s, learned or {}))


def _false_alarms(room: Room, alarm_s: float) -> tuple[int, float]:
    """How many verdicts named a movement while nobody did any, and in how many seconds."""
    room.say(f"now {alarm_s / 60:.1f} minutes of anything but the movements: each verdict is a false alarm (s: skip)")
    room.pause(2.0)
    room.verdicts()
    begun_s, alarms = room.now_s(), 0
    while (left_s := begun_s + alarm_s - room.now_s()) > 0:
        step = Step("alarms", number=alarms, left_s=left_s)
        room.show(step)
        if room.between(step, min(1.0, left_s)).kind == "skip":
            break
        for label in room.verdicts():
            if label != ABSTAIN:
                alarms += 1
                room.say(f"false alarm: {label}")
    return alarms, room.now_s() - begun_s
