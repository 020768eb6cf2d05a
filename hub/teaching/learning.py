"""The second half of a lesson: all observers learn, and then change together."""

from collections.abc import Mapping

from common.errors import LabanmeshError
from common.teaching_messages import LearnedReport, TeachReply
from hub.teaching.pupils import Pupils
from hub.teaching.room import Step
from hub.teaching.wording import adopted_line, missing_line, result_lines, without_takes

LOOK_S = 0.2
LEARN_LIMIT_S = 900.0
ADOPT_IN_S = 0.7
FOLLOW_S = 10.0


def learn(pupils: Pupils) -> dict[str, LearnedReport]:
    """What each observer has learned; one that cannot is left out. Raises LabanmeshError if too few can."""
    room = pupils.room
    pupils.take_back()
    others = _leave_out_those_without_takes(pupils)
    pupils.request("learn", labels=pupils.labels)
    begun_s, learned, replies = room.now_s(), dict[str, LearnedReport](), dict[str, TeachReply]()
    while len(learned) < len(pupils.observers) and room.now_s() - begun_s < LEARN_LIMIT_S:
        count, seconds = len(pupils.observers), room.now_s() - begun_s
        room.show(Step("learning", number=len(learned), of=count, left_s=seconds))
        room.pause(LOOK_S)
        replies = dict(pupils.request("status"))
        learned |= {name: reply.learned for name, reply in replies.items() if reply.learned is not None}
        _learn_again(pupils, replies)
    others += sum(bool(replies[name].labels) for name in replies if name not in learned)
    if len(learned) <= others:
        raise LabanmeshError("most observers could not learn; nothing changes, and the takes are kept")
    for line in result_lines(learned):
        room.say(line)
    return learned


def adopt(pupils: Pupils, learned: Mapping[str, LearnedReport]) -> None:
    """All change together; then the fusion service follows. Raises LabanmeshError if it does not."""
    room = pupils.room
    room.show(Step("adopting"))
    pupils.observers = [name for name in pupils.observers if name in learned]
    pupils.request("adopt", in_s=ADOPT_IN_S)
    begun_s = room.now_s()
    while room.now_s() - begun_s < FOLLOW_S:
        room.pause(LOOK_S)
        late = [name for name, reply in pupils.request("status").items() if reply.learned is not None]
        if late:
            pupils.request_of("adopt", late)
        if list(room.fused_labels()) == pupils.labels:
            room.say(adopted_line(len(pupils.observers), pupils.labels))
            return
    raise LabanmeshError("the observers have new models; the fusion service has not followed: is it running?")


def _leave_out_those_without_takes(pupils: Pupils) -> int:
    """How many of those that are left out publish; the fusion service follows more than half of all that do."""
    replies = pupils.request("status")
    missing = without_takes(pupils.labels, replies)
    for name, labels in missing.items():
        pupils.room.say(missing_line(name, labels))
    pupils.observers = [name for name in pupils.observers if name not in missing]
    others = sum(bool(replies[name].pictures and replies[name].labels) for name in missing)
    if len(pupils.observers) <= others:
        raise LabanmeshError("too few observers have takes of all movements; nothing changes, and takes are kept")
    return others


def _learn_again(pupils: Pupils, replies: Mapping[str, TeachReply]) -> None:
    """Leave out the observers that could not learn; one that was started again meanwhile learns again."""
    idle = [name for name in pupils.observers if replies[name].state == "idle"]
    restarted = [name for name in idle if not replies[name].fault]
    if restarted:
        pupils.request_of("learn", restarted, labels=pupils.labels)
    pupils.observers = [name for name in pupils.observers if name not in idle or name in restarted]
