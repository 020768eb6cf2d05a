"""A person, a movement, or all that was taught is forgotten everywhere; earlier takes are restored. Pure.

1. Each observer removes its takes, also those that were set aside, and its old models. What the model in force was
   learned from stays in it, so the observers learn anew from what is left, and change together.
2. An observer without enough takes to learn from loses its model, and waits to be taught.
3. At the end each is asked again: nothing may be left then, also not in the model that has just been replaced.
4. Takes that were set aside because another lesson began are listed for people, and one of them restored.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from common.errors import BadInput, LabanmeshError
from common.teaching_messages import EarlierTakes, ForgottenReport, TeachReply, Unwanted
from common.text import nearest, plural
from hub.teaching.correcting import vocabulary_in_force
from hub.teaching.learning import adopt, learn
from hub.teaching.participants import Participants
from hub.wording import calendar_time

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


def list_earlier(participants: Participants, file: str) -> None:
    """Print the takes that were set aside, newest first. file: the scene file, for the command that restores them."""
    say = participants.interface.say
    lines = earlier_lines({name: reply.earlier for name, reply in participants.request("earlier").items()})
    for line in lines or ["no takes were set aside"]:
        say(line)
    if lines:
        say(f"make them the takes of now: labanmesh teach {file} --restore ID")


def restore(participants: Participants, wanted: str, file: str) -> None:
    """Make the earlier takes with the id `wanted` the current ones, and set those aside.

    Raises BadInput for an unknown id, LabanmeshError if an observer that has them could not.
    """
    known = {name: reply.earlier for name, reply in participants.request("earlier").items()}
    chosen = {name: each for name, sets in known.items() for each in sets if each.id == wanted}
    if not chosen:
        ids = ", ".join(dict.fromkeys(each.id for sets in known.values() for each in sets))
        raise BadInput(f"--restore {wanted[:64]}: no observer has such takes; known: {ids or 'none'}")
    participants.observers = list(chosen)
    replies = participants.request("restore", earlier=wanted)
    if failed := [name for name in chosen if name not in replies or replies[name].fault]:
        raise LabanmeshError(f"not restored by {', '.join(failed)}: the lines above say why")
    labels = dict.fromkeys(label for each in chosen.values() for label in each.labels or each.takes)
    participants.interface.say(
        f"restored by {', '.join(chosen)}; go on with them: labanmesh teach {file} {' '.join(labels)}"
    )


def earlier_lines(known: Mapping[str, Sequence[EarlierTakes]]) -> list[str]:
    """A line for each set by id, the newest first: when it was set aside, and what each observer has."""
    newest_first = sorted((each for sets in known.values() for each in sets), key=lambda each: -each.at_ns)
    lines = []
    for own in dict.fromkeys(each.id for each in newest_first):
        of_id = {name: each for name, sets in known.items() for each in sets if each.id == own}
        moment = calendar_time(max(each.at_ns for each in of_id.values()))
        when = "" if moment is None else f", set aside on {moment.astimezone():%d %B at %H:%M}"
        begun = ", lesson not finished" if any(each.labels for each in of_id.values()) else ""
        lines.append(f"{own}{when}{begun}: " + "; ".join(f"{name}: {_held(each)}" for name, each in of_id.items()))
    return lines


def _held(earlier: EarlierTakes) -> str:
    parts = [f"{plural(count, 'take')} of {label}" for label, count in earlier.takes.items()]
    parts += [f"{earlier.other_s:.0f} s of something else"] if earlier.other_s else []
    return ", ".join(parts) or "cannot be read"
