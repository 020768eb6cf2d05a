"""Takes that observers have set aside because another lesson began: a list for people, and one of them again. Pure."""

from collections.abc import Mapping, Sequence

from common.errors import BadInput, LabanmeshError
from common.teaching_messages import EarlierTakes
from common.text import plural
from hub.teaching.participants import Participants
from hub.wording import calendar_time


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
