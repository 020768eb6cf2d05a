"""Verdicts that were wrong or missed become examples on every observer, and then all learn anew. Pure.

1. Times are the fusion service's, as in verdicts; each observer is asked in the time of its own clock.
2. Of a movement without a verdict only the moment is known: the first observer that saw somebody move then says from
   when to when, and the others cut the same.
3. An observer that cannot make an example says why in a line, and the others go on.
"""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

from common import SECOND_NS
from common.errors import BadInput, LabanmeshError
from common.messages import VerdictMessage
from common.teaching_messages import SOMEONE, TeachReply, only_person
from common.text import nearest
from hub.scene_state import SOMETHING_ELSE, SceneState
from hub.teaching.learning import adopt, learn
from hub.teaching.participants import Participants
from hub.wording import clock_time, label_words

NOT_TAUGHT = "its model was not made by labanmesh teach, and cannot be corrected"
NOTHING = "nothing"
"""Stands for something else than any movement; it can be no movement's name then."""
NEAR_NS = 1.5 * SECOND_NS
"""A verdict this near to a time is meant by it."""
_TIME = re.compile(r"(\d{1,2}):(\d\d):(\d\d)\Z")
_AGO = re.compile(r"(\d{1,6}(?:\.\d{1,6})?)\s*(s|min)\Z")
_ID = re.compile(r"(?P<scene>[a-z0-9_-]+)-(?P<began_ms>\d{12,14})\Z")
FORMS = "the id of a verdict, last, a time of day (20:14:03), two (20:14:03..20:14:06), or how long ago (30s, 2min)"


@dataclass(frozen=True, slots=True)
class MomentExample:
    """The example cut out for a moment: the number of its take on each observer that has one."""

    label: str
    takes: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class Correction:
    """What somebody did, from `began_ns` to `ended_ns` in the time of the fusion service.

    id: of the verdict, or any other for a movement without one; a second correction with the same id replaces the
    first. label: what it was; "": none of the movements. ended_ns: None: until the person stood still; the same as
    began_ns: the movement nearest to that moment.
    """

    id: str
    label: str
    began_ns: int
    ended_ns: int | None = None

    @classmethod
    def of_verdict(cls, verdict: VerdictMessage, label: str) -> "Correction":
        """What the movement of this verdict really was."""
        return cls(verdict.id, label, verdict.began_ns, verdict.ended_ns)

    @property
    def is_moment(self) -> bool:
        """Whether only the moment is known."""
        return self.ended_ns == self.began_ns


def correction_of(when: str, label: str, verdicts: Sequence[VerdictMessage], now: datetime) -> Correction:
    """The correction that `--was WHEN LABEL` asks for.

    verdicts: those that are remembered, newest first. now: local, by the fusion service's clock. Raises BadInput.
    """
    label = "" if label == NOTHING else label
    if when == "last":
        if not verdicts:
            raise BadInput("--was last: no verdict is remembered; say when it was: " + FORMS)
        return Correction.of_verdict(verdicts[0], label)
    if (verdict := next((each for each in verdicts if each.id == when), None)) is not None:
        return Correction.of_verdict(verdict, label)
    if (match := _ID.match(when)) is not None:
        # The id of a verdict that the fusion service no longer remembers: its movement began then.
        return Correction(when, label, int(match["began_ms"]) * 1_000_000)
    begin, separator, end = when.partition("..")
    began_ns = _moment_ns(begin, now)
    if separator:
        ended_ns = _moment_ns(end, now)
        if began_ns is None or ended_ns is None or ended_ns <= began_ns:
            raise BadInput(f"--was {when}: the end is not after the begin; two times are expected: 20:14:03..20:14:06")
        return Correction(f"span-{began_ns // 1_000_000}", label, began_ns, ended_ns)
    if began_ns is None:
        raise BadInput(f"--was {when}: {FORMS} is expected{remembered(verdicts)}")
    near = [each for each in verdicts if _distance_ns(each, began_ns) <= NEAR_NS]
    if near:
        return Correction.of_verdict(min(near, key=lambda each: _distance_ns(each, began_ns)), label)
    return Correction(f"moment-{began_ns // 1_000_000}", label, began_ns, began_ns)


def fusion_ns(state: SceneState, machine_ns: int) -> int:
    """The time now by the clock of the fusion service, ns; this machine's if it says none."""
    if state.judgement is None:
        return machine_ns
    return state.judgement.at_ns + round(state.silence_s * SECOND_NS)


def remembered(verdicts: Sequence[VerdictMessage]) -> str:
    """The verdicts that can be named, as the end of a line; "" without any."""
    known = ", ".join(f"{each.id} ({clock_time(each.began_ns)} {label_words(each)})" for each in verdicts)
    return f"; the last verdicts: {known}" if known else ""


def _moment_ns(text: str, now: datetime) -> int | None:
    """A time of day, the last before now, or how long ago; None for anything else."""
    if (match := _AGO.match(text)) is not None:
        at = now - timedelta(seconds=float(match[1]) * (60 if match[2] == "min" else 1))
    elif (match := _TIME.match(text)) is not None and int(match[1]) < 24 and int(match[2]) < 60 and int(match[3]) < 60:
        at = now.replace(hour=int(match[1]), minute=int(match[2]), second=int(match[3]), microsecond=0)
        at = at if at <= now else at - timedelta(days=1)
    else:
        return None
    return round(at.timestamp() * SECOND_NS)


def _distance_ns(verdict: VerdictMessage, at_ns: int) -> int:
    """How far a moment is from the movement of a verdict; 0 within it."""
    ended_ns = verdict.ended_ns or verdict.decided_ns
    return max(verdict.began_ns - at_ns, at_ns - ended_ns, 0)


def clock_offsets(state: SceneState) -> dict[str, float]:
    """Seconds by which the clock of each observer is ahead of the fusion service's, as far as it is known."""
    return {each.name: each.skew_s for each in state.observers if each.skew_s is not None}


def correct(
    participants: Participants,
    corrections: Sequence[Correction],
    offsets: Mapping[str, float],
    person: str,
    of_moments: list[MomentExample] | None = None,
) -> dict[str, int]:
    """Let each observer cut an example for each correction; returns how many each has made. They do not learn yet.

    person: who moved; "": the only person whom the observers have takes of, else SOMEONE. of_moments: a list to which
    the examples are added of which only the moment was known, so that they can be shown.

    Raises BadInput for a label that they do not know, LabanmeshError if no observer could make any example.
    """
    replies = participants.request("status")
    _leave_out_the_untaught(participants, replies)
    known = tuple(dict.fromkeys(label for name in participants.observers for label in replies[name].labels))
    person = person or only_person({each for name in participants.observers for each in replies[name].persons})
    for correction in corrections:
        if correction.label and correction.label not in known:
            raise BadInput(
                f"{correction.label} is not taught ({nearest(correction.label, known)}); teach it first: "
                f"labanmesh teach SCENE {correction.label} --add"
            )
    made: dict[str, int] = dict.fromkeys(participants.observers, 0)
    for correction in corrections:
        shows = of_moments is not None and correction.is_moment
        before = _takes(participants, correction.label) if shows else {}
        keepers = _correct_one(participants, correction, offsets, person)
        for name in keepers:
            made[name] += 1
        if of_moments is not None and shows and keepers:
            # Its number is not in the answer.
            new = {name: own - before[name] for name, own in _takes(participants, correction.label).items()}
            of_moments.append(MomentExample(correction.label, {name: max(own) for name, own in new.items() if own}))
    if not any(made.values()):
        raise LabanmeshError("no observer could make an example; nothing changes")
    return made


def _takes(participants: Participants, label: str) -> dict[str, set[int]]:
    return {name: set(reply.takes.get(label, ())) for name, reply in participants.request("status").items()}


def learn_corrections(participants: Participants, observers: Collection[str]) -> None:
    """These observers learn from all their takes, and change together; the movements stay. Raises LabanmeshError."""
    replies = participants.request("status")
    participants.observers = [name for name in participants.observers if name in observers]
    participants.labels = vocabulary_in_force([replies[name] for name in participants.observers])
    adopt(participants, learn(participants))


def vocabulary_in_force(replies: Sequence[TeachReply]) -> list[str]:
    """The movements that most of them recognise; raises LabanmeshError if there are none."""
    voices = [tuple(reply.labels) for reply in replies if reply.labels]
    if not voices:
        raise LabanmeshError("no observer has been taught yet: labanmesh teach SCENE LABEL LABEL ...")
    return list(Counter(voices).most_common(1)[0][0])


def _leave_out_the_untaught(participants: Participants, replies: Mapping[str, TeachReply]) -> None:
    for name in list(participants.observers):
        reply = replies[name]
        lacks = [label for label in reply.labels if label not in reply.takes]
        if lacks or not reply.labels:
            participants.interface.say(
                f"{name}: {NOT_TAUGHT if lacks else 'has not been taught yet'}; the others go on"
            )
            participants.observers.remove(name)
    if not participants.observers:
        raise LabanmeshError("no observer can be corrected: teach them first: labanmesh teach SCENE LABEL LABEL ...")


def _correct_one(
    participants: Participants, correction: Correction, offsets: Mapping[str, float], person: str
) -> list[str]:
    lengths: dict[str, float] = {}
    faults: dict[str, str] = {}
    span = correction
    for name in participants.observers:
        offset_ns = round(offsets.get(name, 0.0) * SECOND_NS)
        answers = participants.request_of(
            "correct", [name], correction=span.id, label=span.label, person=person, from_ns=span.began_ns + offset_ns,
            to_ns=0 if span.ended_ns is None else span.ended_ns + offset_ns,
        )  # fmt: skip
        reply = answers.replies.get(name)
        if reply is None or reply.corrected is None:
            faults[name] = "no answer" if reply is None else reply.fault or "is of a version that cannot be corrected"
            continue
        report = reply.corrected
        lengths[name] = report.seconds
        if span.is_moment:
            span = replace(span, began_ns=report.from_ns - offset_ns, ended_ns=report.to_ns - offset_ns)
    keepers = ", ".join(f"{name} ({seconds:.1f} s)" for name, seconds in lengths.items())
    what = (correction.label or SOMETHING_ELSE) + ("" if person == SOMEONE else f" by {person}")
    participants.interface.say(
        f"{clock_time(span.began_ns)} was {what}: {f'kept by {keepers}' if keepers else 'kept by no observer'}"
    )
    for name, fault in faults.items():
        participants.interface.say(f"  {name}: {fault}")
    return list(lengths)
