"""The lines that a teacher reads: present observers, the last take, confused movements. Pure."""

from collections.abc import Collection, Mapping, Sequence

from common.teaching_messages import LearnedReport, TeachReply
from common.text import periods_line, plural
from common.vocabulary import ABSTAIN
from hub.teaching.interface import Step

SIGN_NAMES = {"now": "now", "key": "press a key", "clap": "clap", "still": "stand still"}
AT = {"left": "on the left", "middle": "in the middle", "right": "on the right"}
LEAST_S = 6.0
"""A shorter time tells nothing about false alarms."""
ALIKE_SHARE = 0.2
"""Two movements look alike from where this share of the takes of one is taken for the other."""
TYPED = {
    "the same command goes on": "Go on continues",
    "the lines above say why; give the command again": "the lines below say why; forget it again then",
    "give the command again when it runs": "forget it again when it runs",
    "; or press a key": "",
    " (--clips)": "",
    "? r makes it again": "? If not, make it again",
}
"""Ways out in a terminal, and what they are on a page."""
KEY_HINTS = {"; or press a key": "", " (s: skip)": "", "? r makes it again": "?"}
"""Keys in a line, and what it says where there is no keyboard."""
NO_RIGHT = (
    "no observer answers a request to teach: they are of an earlier version, or this machine's certificate lacks the "
    "right to teach (labanmesh secure add SCENE NAME --hub --teach)"
)


def presence_line(name: str, reply: TeachReply) -> str:
    """Whether an observer is ready, in one line."""
    if reply.visible:
        seen = f"sees somebody{f'; {reply.complaint}' if reply.complaint else ''}"
        if reply.side is not None:
            seen = f"sees {plural(reply.people or 2, 'person', 'people')} and learns from the one {AT[reply.side]}"
        return f"{name}: {seen}"
    return f"{name}: {reply.complaint or 'sees nobody: stand where it sees head and hands'}"


def placeless(replies: Mapping[str, TeachReply]) -> list[str]:
    """The observers that may learn from another person than the others: they do not know where those stand."""
    if len(replies) == 1 or all(reply.side is None for reply in replies.values()):
        return []
    return [name for name, reply in replies.items() if reply.visible and reply.place is None]


def step_line(step: Step) -> str:
    """What happens now, for a terminal; "" for what it does not show."""
    title = f"test: {step.label}" if step.is_test else f"{step.label} {step.number} of {step.of}"
    match step.kind:
        case "countdown":
            return f"{title}: {step.left_s:.0f}"
        case "now":
            return f"{title}: now"
        case "waiting":
            return f"{title}: {SIGN_NAMES[step.how]}"
        case "kept" | "failed":
            return f"{title}: {step.kind}"
        case "doubt":
            return f"{step.label} {step.number}: r makes this take again"
        case "alarms":
            return f"none of the movements: {step.left_s:.0f} s to go, {step.number} false alarms"
        case "other":
            return f"something else: {step.left_s:.0f} s to go"
        case "learning":
            return f"learning: {step.number} of {step.of}, {step.left_s:.0f} s"
    return ""


def take_lines(replies: Mapping[str, TeachReply]) -> list[str]:
    """The outcome of the last take: a line that names the observers that kept it, and a line for each other one."""
    takes = {name: reply.take for name, reply in replies.items() if reply.take and reply.take.state == "kept"}
    keepers = ", ".join(f"{name} ({take.seconds:.1f} s)" for name, take in takes.items())
    lines = [f"kept by {keepers}"] if keepers else []
    for name, reply in replies.items():
        if name not in takes:
            lines.append(f"{name}: {reply.take.fault if reply.take and reply.take.fault else 'no take'}")
    return lines


def crowd_lines(replies: Mapping[str, TeachReply]) -> list[str]:
    """The lines if another person was in the last take."""
    takes = {name: reply.take for name, reply in replies.items() if reply.take and reply.take.people > 1}
    if not takes:
        return []
    places = ", ".join(
        f"{plural(take.people, 'person', 'people')} in the picture of {name}"
        + (f", the take is of the one {AT[take.side]}" if take.side else "")
        for name, take in takes.items()
    )
    return [f"{places}: is the take yours? r makes it again"]


def doubt_lines(replies: Mapping[str, TeachReply]) -> list[str]:
    """The takes that resemble another movement, and the observers that say so."""
    places: dict[tuple[str, int, str], list[str]] = {}
    for name, reply in replies.items():
        for doubt in reply.doubts:
            places.setdefault((doubt.label, doubt.take, doubt.like), []).append(name)
    return [
        f"{label} {place_of(label, take, replies)} looks more like {like} than like the other takes of {label}, from "
        f"{' and '.join(names)}"
        for (label, take, like), names in places.items()
    ]


def place_of(label: str, take: int, replies: Mapping[str, TeachReply]) -> int:
    """The place of a take among the kept ones of its movement, from 1: dropped and failed takes have numbers, too."""
    return len([number for number in takes_done(label, replies) if number <= take])


def doubted_by_all(replies: Mapping[str, TeachReply]) -> list[tuple[str, int]]:
    """The takes, as label and number, that all observers which have them doubt."""
    doubted = [(doubt.label, doubt.take) for reply in replies.values() for doubt in reply.doubts]
    had = {each: sum(each[1] in reply.takes.get(each[0], ()) for reply in replies.values()) for each in doubted}
    return [each for each in dict.fromkeys(doubted) if doubted.count(each) == had[each]]


def has_kept(replies: Mapping[str, TeachReply]) -> bool:
    """Whether some observer kept the last take."""
    return any(reply.take is not None and reply.take.state == "kept" for reply in replies.values())


def result_lines(learned: Mapping[str, LearnedReport]) -> list[str]:
    """Lines on each model: left-out takes recognised, repeated movements, and movements that look alike."""
    lines = []
    for name, report in learned.items():
        rows = [(label, report.results.get(label, {})) for label in report.labels]
        known = [f"{label} {row.get(label, 0)} of {sum(row.values())}" for label, row in rows if row]
        lines.append(f"{name}: {', '.join(known) or 'learned'}")
    # From where it is seen hardly changes the period of a movement.
    reports = [report for report in learned.values() if set(report.periods) <= set(report.labels)]
    periods = {label: period_s for report in reports for label, period_s in report.periods.items()}
    return [*lines, *([periods_line(periods)] if periods else []), *alike_lines(learned)]


def reference_lines(learned: Mapping[str, LearnedReport], wanted: Collection[str]) -> list[str]:
    """Which movements each model scores, and which it was to score and has too few takes of."""
    lines = []
    for name, report in learned.items():
        own = [f"{label} by {plural(count, 'reference take')}" for label, count in report.references.items()]
        lines += [f"{name}: scores {', '.join(own)}"] if own else []
        missing = [label for label in wanted if label not in report.references]
        lines += [f"{name}: cannot score {', '.join(missing)}: at least three takes have to be kept"] if missing else []
    return lines


def alike_lines(learned: Mapping[str, LearnedReport]) -> list[str]:
    """The movements that are confused in left-out takes, and the observers that confuse them."""
    places: dict[tuple[str, str], list[str]] = {}
    for name, report in learned.items():
        for one, row in report.results.items():
            takes = sum(row.values())
            for other, count in row.items():
                # An observer is a peer: its results may name what its model does not have.
                if other != one and {one, other} <= set(report.labels) and count > ALIKE_SHARE * takes:
                    first, second = sorted((one, other), key=report.labels.index)
                    observers = places.setdefault((first, second), [])
                    if name not in observers:
                        observers.append(name)
    return [f"{one} and {two} look alike from {' and '.join(names)}" for (one, two), names in places.items()]


def vocabulary_of(labels: Sequence[str], replies: Mapping[str, TeachReply], *, add: bool) -> list[str]:
    """The movements to learn: `labels`; with `add` after those that have takes, in the order of the models."""
    if not add:
        return list(labels)
    in_force = [label for reply in replies.values() for label in reply.labels if label in reply.takes]
    recorded = [label for reply in replies.values() for label in reply.takes]
    return list(dict.fromkeys((*in_force, *sorted(recorded), *labels)))


def takes_done(label: str, replies: Mapping[str, TeachReply]) -> set[int]:
    """The numbers of the takes of a movement that some observer has on its disk."""
    return {take for reply in replies.values() for take in reply.takes.get(label, ())}


def summary_line(right: Mapping[str, bool], alarms: int, alarm_s: float, learned: Mapping[str, LearnedReport]) -> str:
    """The result of the test in one line: how many movements, false alarms, and movements that look alike."""
    parts = [f"{sum(right.values())} of {len(right)} recognised"]
    if alarm_s >= LEAST_S:
        parts.append(f"{plural(alarms, 'false alarm')} in {round(alarm_s / 60, 1):g} minutes")
    return "; ".join([", ".join(parts), *alike_lines(learned)])


def outcome_line(label: str, decided: str) -> str:
    """The fusion service's verdict on a movement, in words; "" if there is none."""
    if decided == label:
        return f"{label}: recognised"
    if decided in ("", ABSTAIN):
        return f"{label}: {'nothing was decided' if not decided else 'the observers did not agree'}"
    return f"{label}: taken for {decided}"


def known_labels(replies: Mapping[str, TeachReply | None]) -> list[str]:
    """The movements of all models in force, in the order of the first."""
    return list(dict.fromkeys(label for reply in replies.values() if reply for label in reply.labels))


def begun_labels(replies: Mapping[str, TeachReply | None]) -> list[str]:
    """The movements that have takes but are in no model: those of an unfinished lesson."""
    known = set(known_labels(replies))
    return sorted({label for reply in replies.values() if reply for label in reply.takes} - known)


def reworded(line: str, words: Mapping[str, str]) -> str:
    """A line without ways out and keys that are not at hand: `words` is TYPED or KEY_HINTS."""
    for before, after in words.items():
        line = line.replace(before, after)
    return line
