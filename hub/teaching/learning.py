"""The second half of a lesson: all observers learn, and then change together."""

from collections.abc import Mapping

from common.errors import LabanmeshError
from common.teaching_messages import LearnedReport, TeachReply
from hub.teaching.interface import LOOK_S, Step
from hub.teaching.participants import Participants
from hub.teaching.wording import adopted_line, missing_line, reference_lines, result_lines, without_takes

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
            interface.say(adopted_line(len(participants.observers), participants.labels))
            return
    raise LabanmeshError("the observers have new models; the fusion service has not followed: is it running?")


def _leave_out_those_without_takes(participants: Participants) -> int:
    """How many of those that are left out publish; the fusion service follows more than half of all that do."""
    replies = participants.request("status")
    missing = without_takes(participants.labels, replies)
    for name, labels in missing.items():
        participants.interface.say(missing_line(name, labels))
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
