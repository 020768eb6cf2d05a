"""The JSON of the Teach page: the state of the lesson for the page, and requests from it. Pure."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, get_args

from common import MS_NS
from common.errors import BadInput
from common.message_types import LAST_INTEGER
from common.messages import VerdictMessage
from common.teaching_messages import TeachReply, Unwanted, require_person
from common.text import nearest
from common.vocabulary import LABEL, require_teachable
from hub.scene_state import is_abstention
from hub.teaching.forgetting import clip_keepers_of
from hub.teaching.interface import Action, ActionKind, Begin
from hub.teaching.lesson import LessonPlan
from hub.teaching.page_memory import Missed, WantedCorrections
from hub.teaching.wording import begun_labels, known_labels, presence_line

if TYPE_CHECKING:
    from hub.teaching.lesson_server import LessonServer
    from hub.teaching.page_interface import Line, PageLesson

Json = dict[str, Any]
LABELS_MOST, TAKES, MINUTES, SECONDS = 30, (2, 20), (0.0, 15.0), (0.5, 12.0)
NAME_MOST = 64
MISSED_MOST, AGO_S = 10, (0.0, 3600.0)
NEWS_SHOWN = 4
TAKE_DIGITS = len(str(LAST_INTEGER)) - 1
"""With so many digits every number fits into a message."""
TAKE_STEPS = ("ready", "waiting", "countdown", "now", "kept", "failed", "between", "review", "doubt")
MEMORY_STEPS = ("look", "examples")
ACTIONS: dict[str, ActionKind] = {kind: kind for kind in get_args(ActionKind)}
BEGINS: dict[str, Begin] = {begin: begin for begin in ("still", "clap", "now")}


def lesson_server_data(lesson_server: "LessonServer") -> Json:
    """The state of teaching as the page shows it: observers, known movements, and the lesson."""
    version, replies, lesson = lesson_server.version, lesson_server.observers, lesson_server.lesson
    pictures = {name for name, section in lesson_server.scene.observers.items() if section.picture_hz}
    clip_keepers = clip_keepers_of(lesson_server.scene)
    return {
        "version": version,
        "scene": lesson_server.scene.scene,
        "known": known_labels(replies),
        "begun": begun_labels(replies),
        "remembers": lesson_server.scene.teaching.remember_minutes > 0,
        "observers": [
            {
                **_observer(name, reply, name in lesson_server.silent),
                "picture": name in pictures,
                "clips": name in clip_keepers,
            }
            for name, reply in replies.items()
        ],
        "said": [_verdict(each) for each in lesson_server.verdicts],
        "lesson": None if lesson is None else _lesson(lesson),
    }


def take_number(text: str) -> int | None:
    """The number of a take in a URL; None if no take can have it."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= TAKE_DIGITS else None


def plan_of(fields: Mapping[str, Any], known: list[str], teacher: str) -> LessonPlan:
    """The plan that was chosen on the page; raises BadInput, one line, for what cannot be taught.

    known: the movements of the models in force.
    """
    labels = fields.get("labels")
    if not isinstance(labels, list) or not all(isinstance(label, str) for label in labels):
        raise BadInput("labels: a list of names is expected")
    add = fields.get("add") is True
    _check_labels(labels, known if add else [])
    person = _person(fields, "someone")
    seconds, begin = fields.get("seconds"), BEGINS.get(str(fields.get("begin", "still")))
    if begin is None:
        raise BadInput(f"begin: one of {', '.join(BEGINS)} is expected")
    return LessonPlan(
        labels=labels, teacher=teacher, person=person, add=add, test=True, begin=begin,
        takes=int(_number(fields, "takes", 5, *TAKES)),
        background_s=60 * _number(fields, "minutes", 2.0, *MINUTES),
        alarm_s=60 * _number(fields, "alarm_minutes", 1.0, *MINUTES),
        seconds=None if seconds is None else _number(fields, "seconds", 3.0, *SECONDS),
    )  # fmt: skip


def action_of(fields: Mapping[str, Any]) -> Action:
    """The action that was pressed; raises BadInput for an unknown one."""
    kind, take = ACTIONS.get(str(fields.get("action"))), fields.get("take", 0)
    if kind is None or not isinstance(take, int) or isinstance(take, bool) or take < 0:
        raise BadInput(f"action: one of {', '.join(ACTIONS)} is expected")
    return Action(kind, take)


def corrections_of(fields: Mapping[str, Any], known: list[str]) -> WantedCorrections:
    """What movements really were; raises BadInput.

    labels: by the ids of verdicts, "" for none of the movements. missed: movements that had no verdict, each with how
    many seconds ago. person: who performed.
    """
    labels, missed = fields.get("labels", {}), fields.get("missed", [])
    if not isinstance(labels, dict) or not all(isinstance(label, str) for label in labels.values()):
        raise BadInput("labels: what each verdict should have been is expected")
    if not isinstance(missed, list) or len(missed) > MISSED_MOST or not all(isinstance(each, dict) for each in missed):
        raise BadInput(f"missed: at most {MISSED_MOST} movements are expected, each with label and ago_s")
    moments = [Missed(str(each.get("label", "")), _number(each, "ago_s", 0.0, *AGO_S)) for each in missed]
    for label in (*filter(None, labels.values()), *(each.label for each in moments)):
        if label not in known:
            raise BadInput(
                f"{label[:NAME_MOST] or 'a movement'} is not taught ({nearest(label, known)}); teach it first"
            )
    return WantedCorrections({str(verdict): label for verdict, label in labels.items()}, moments, _person(fields, ""))


def unwanted_of(fields: Mapping[str, Any]) -> Unwanted:
    """What is to be forgotten: a person, a movement, or everything; raises BadInput."""
    person, label, everything = _person(fields, ""), fields.get("label") or "", fields.get("everything", False)
    if not isinstance(label, str) or not isinstance(everything, bool) or bool(person) + bool(label) + everything != 1:
        raise BadInput("what is to be forgotten? One of a person, a movement, and everything is expected")
    if label and not LABEL.match(label):
        raise BadInput(f"{label[:NAME_MOST]!r}: no movement can have this name")
    return Unwanted(person, label, everything)


def _person(fields: Mapping[str, Any], default: str) -> str:
    person = str(fields.get("person") or default).strip()
    require_person(person)
    return person


def _check_labels(labels: list[str], known: list[str]) -> None:
    if not labels:
        raise BadInput("name at least one movement")
    if len(labels) > LABELS_MOST:
        raise BadInput(f"{len(labels)} movements at once: teach at most {LABELS_MOST}, and add more later")
    for label in labels:
        if not label.strip():
            raise BadInput("a movement has no name; give it one, such as wave")
    require_teachable(labels)
    if len(set(labels)) != len(labels):
        raise BadInput("a movement is named twice; name each once")
    if len({*labels, *known}) < 2:
        raise BadInput("one movement alone cannot be told from another: name at least two")


def _number(fields: Mapping[str, Any], name: str, default: float, least: float, most: float) -> float:
    value = fields.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise BadInput(f"{name}: a number from {least:g} to {most:g} is expected")
    return float(value)


def _lesson(lesson: "PageLesson") -> Json:
    shown, plan = lesson.interface.shown, lesson.plan
    lines = shown.lines
    return {
        "id": lesson.id,
        "number": shown.number,
        "waits": shown.waits,
        "step": {**asdict(shown.step), "left_s": round(shown.step.left_s, 1)},
        "purpose": lesson.purpose,
        "examples": [{"label": each.label, "takes": dict(each.takes)} for each in lesson.examples],
        **({"labels": []} if plan is None else _plan(plan)),
        "over": lesson.over,
        "stopped": lesson.stopped,
        "fault": lesson.fault,
        "news": _news(lesson),
        "results": [line.text for line in lines if line.kind == "learning"],
        "done": [
            line.text for line in lines if lesson.purpose == "forget" or (plan is None and line.kind in MEMORY_STEPS)
        ],
        "test": [line.text for line in lines if _is_outcome(line)],
        "adopted": any(line.kind == "adopting" for line in lines),
    }


def _is_outcome(line: "Line") -> bool:
    """Whether a line reports a result of the test; the others announce what to do."""
    return (line.is_test or line.kind == "alarms") and not line.text.startswith("now ")


def _plan(plan: LessonPlan) -> Json:
    return {
        "labels": list(plan.labels),
        "takes": plan.takes,
        "add": plan.add,
        "person": plan.person,
        "minutes": plan.background_s / 60,
        "alarm_minutes": plan.alarm_s / 60,
        "begin": plan.begin,
        "seconds": plan.seconds,
    }


def _verdict(verdict: VerdictMessage) -> Json:
    return {
        "id": verdict.id,
        "label": "" if is_abstention(verdict) else verdict.label,
        "began": verdict.began_ns // MS_NS,
        "ended": verdict.ended_ns is not None,
    }


def _news(lesson: "PageLesson") -> list[str]:
    """The lines on the step that is shown: on the last take, or why the lesson cannot go on."""
    lines, step = lesson.interface.shown.lines, lesson.interface.shown.step
    if lesson.over:
        return [line.text for line in lines[-NEWS_SHOWN:]] if lesson.fault and not lesson.stopped else []
    if step.kind in TAKE_STEPS and step.kind != "waiting" and step.label and not step.is_test:
        # How the takes begin is the stage's to say.
        takes = [line for line in lines if line.kind in TAKE_STEPS and not line.is_test]
        newest = [line.text for line in takes if not line.text.endswith(" to begin")][-2 * NEWS_SHOWN :]
        begins = [n for n, text in enumerate(newest) if text.startswith(f"{step.label} ")]
        return newest[begins[-1] if begins else 0 :][-NEWS_SHOWN:]
    return [line.text for line in lines if line.kind == step.kind and step.kind in ("learning", "other")][-NEWS_SHOWN:]


def _observer(name: str, reply: TeachReply | None, silent: bool) -> Json:
    if reply is None:
        line = "runs, and cannot be taught from here" if silent else "does not run"
        return {"name": name, "ready": False, "line": line}
    take = reply.take
    return {
        "name": name,
        "ready": reply.visible and not reply.complaint,
        "pictures": reply.pictures,
        "line": presence_line(name, reply).partition(": ")[2],
        "state": reply.state,
        "fault": reply.fault,
        "take": None if take is None else {**take.model_dump(), "seconds": round(take.seconds, 1)},
        "takes": dict(reply.takes),
        "persons": {person: dict(counts) for person, counts in reply.persons.items()},
        "other": round(reply.other_s),
        "labels": list(reply.labels),
        "learned": None if reply.learned is None else reply.learned.results,
    }
