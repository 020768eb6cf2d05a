"""A person, a movement, or everything that was taught is forgotten by all observers of a scene. Pure.

1. Each observer removes its takes, also those that were set aside, and its old models. What the model in force was
   learned from stays in it, so the observers learn anew from what is left, and change together.
2. An observer without enough takes to learn from loses its model, and waits to be taught.
3. At the end each is asked again: nothing may be left then, also not in the model that has just been replaced.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from common.errors import LabanmeshError
from common.teaching_messages import ForgottenReport, TeachReply, Unwanted
from common.text import nearest, plural
from hub.teaching.correcting import vocabulary_in_force
from hub.teaching.learning import adopt, learn
from hub.teaching.participants import Participants

if TYPE_CHECKING:
    from common.config import Scene


def forget(
    participants: Participants, unwanted: Unwanted, missing: Collection[str] = (), *, clips: bool = False
) -> None:
    """Forget it everywhere and say what each observer removed. Raises LabanmeshError if it is left somewhere.

    missing: the observers of the scene that cannot be asked. clips: delete clips of verdicts too.
    """
    interface, fields = participants.interface, asdict(unwanted)
    replies = participants.request("forget", clips=clips, **fields)
    done = {name: reply for name, reply in replies.items() if reply.forgotten is not None}
    for name, reply in done.items():
        interface.say(f"{name}: {removed_line(reply.forgotten or ForgottenReport())}")
    failed = [name for name in replies if name not in done]
    if done and not unwanted.everything and not any(_found(reply) for reply in done.values()):
        interface.say(_unknown_line(unwanted, list(done.values())))
    left = [name for name, reply in done.items() if reply.forgotten and reply.forgotten.in_model]
    if left and not unwanted.everything:
        _learn_anew(participants, unwanted, done, left)
        participants.observers = list(done)
        again = participants.request("forget", **fields)
        failed += [name for name, reply in again.items() if reply.forgotten is None or reply.forgotten.in_model]
    if failed:
        raise LabanmeshError(f"not forgotten by {', '.join(failed)}: the lines above say why; give the command again")
    if missing:
        raise LabanmeshError(f"not forgotten by {', '.join(missing)}: no answer; give the command again when it runs")


def _found(reply: TeachReply) -> bool:
    report = reply.forgotten or ForgottenReport()
    return bool(report.takes or report.other_s or report.models or report.clips or report.in_model)


def _unknown_line(unwanted: Unwanted, replies: Sequence[TeachReply]) -> str:
    name = unwanted.person or unwanted.label
    known = {
        each for reply in replies for each in (reply.persons if unwanted.person else (*reply.labels, *reply.takes))
    }
    return f"nobody had anything of {name}" + (f": {nearest(name, sorted(known))}" if known else "")


def removed_line(report: ForgottenReport) -> str:
    """What an observer removed."""
    parts = [plural(report.takes, "take")] if report.takes else []
    parts += [f"{report.other_s:.0f} s of something else"] if report.other_s else []
    parts += [plural(report.models, "model")] if report.models else []
    parts += [plural(report.clips, "clip")] if report.clips else []
    line = f"removed {', '.join(parts)}" if parts else "had nothing of it on its disk"
    return f"{line}; learns anew without it" if report.in_model else line


def clip_keepers_of(scene: "Scene") -> list[str]:
    """The observers that keep clips of verdicts."""
    return [name for name in scene.roster if scene.observer(name).clips.folder]


def untouched_line(clip_keepers: Collection[str], *, clips: bool) -> str:
    """Which files that may show the person are not removed, and how to remove them."""
    clips_line = "" if clips or not clip_keepers else f"clips of verdicts by {', '.join(clip_keepers)} (--clips), and "
    return f"not touched: {clips_line}files made by labanmesh capture, record and learn: delete those yourself"


def _learn_anew(
    participants: Participants, unwanted: Unwanted, replies: Mapping[str, TeachReply], left: Sequence[str]
) -> None:
    """Those that are left learn from what remains, and change together; where that cannot be, the model goes too."""
    interface = participants.interface
    known = [label for label in vocabulary_in_force(list(replies.values())) if label != unwanted.label]
    # A movement of which nobody has a take any more is forgotten with the person who taught it.
    taken = {label for reply in replies.values() for label in reply.takes}
    participants.labels = [label for label in known if label in taken]
    all_change = participants.labels != vocabulary_in_force(list(replies.values()))
    learning = list(replies) if all_change else left
    changed: list[str] = []
    if len(participants.labels) >= 2:
        has_all = {name: all(replies[name].takes.get(label) for label in participants.labels) for name in learning}
        participants.observers = [name for name in learning if has_all[name]]
        try:
            learned = learn(participants) if participants.observers else {}
            changed = list(learned)
            adopt(participants, learned)
        except LabanmeshError as error:
            interface.say(str(error))
    participants.observers = [name for name in left if name not in changed]
    for name in participants.observers:
        interface.say(
            f"{name}: too little is left to learn from: its model goes too, and labanmesh teach teaches it again"
        )
    if participants.observers:
        participants.request("forget", **{**asdict(unwanted), "models": True})
