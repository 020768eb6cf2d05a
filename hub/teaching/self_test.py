"""The end of a lesson: each movement once more, and what the fusion service says to it."""

from collections.abc import Callable, Sequence

from hub.teaching.room import Room, Step
from hub.teaching.wording import outcome_line

LOOK_S = 0.2
TEST_LIMIT_S = 8.0


def self_test(labels: Sequence[str], room: Room, count_down: Callable[[Step], None]) -> None:
    """Ask for each movement once. count_down: counts down to `now` of a step."""
    room.say("now do each movement once more, and see what the fusion service says")
    right = 0
    for label in labels:
        room.pause(2.0)
        count_down(Step("now", label, is_test=True))
        room.verdicts()
        begun_s, decided = room.now_s(), ""
        while not decided and room.now_s() - begun_s < TEST_LIMIT_S:
            room.pause(LOOK_S)
            decided = next(iter(room.verdicts()), "")
        right += decided == label
        room.say(outcome_line(label, decided))
    room.say(f"{right} of {len(labels)} recognised")
