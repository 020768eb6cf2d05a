"""The sign with which the takes of a movement begin, so that whoever performs needs no keyboard."""

from collections.abc import Mapping

from common.errors import LabanmeshError
from common.teaching_messages import TeachReply
from hub.teaching.interface import LOOK_S, Begin, Step
from hub.teaching.participants import Participants

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
