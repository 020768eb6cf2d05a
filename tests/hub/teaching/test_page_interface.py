"""A lesson that pages show: who may press what and when, and one lesson for everybody, over a real mesh."""

import contextlib
import threading
import time
from types import SimpleNamespace

import pytest
from processes import until

from common import SECOND_NS
from common.config import read_scene
from common.errors import BadInput
from common.link import Link
from common.teaching_messages import (
    CorrectedReport,
    ForgottenReport,
    LearnedReport,
    ShownTracks,
    TakeReport,
    TeachReply,
    TeachRequest,
    Unwanted,
)
from common.wire import decode, encode
from hub.session import SceneUpdate
from hub.teaching.interface import GO, Action, Step
from hub.teaching.lesson import LessonPlan
from hub.teaching.lesson_server import BUSY, LessonServer
from hub.teaching.page_interface import MOVED_ON, PRESSED, PageInterface
from hub.teaching.page_memory import NONE_LEFT, Missed, WantedCorrections


@pytest.fixture
def interface():
    return PageInterface(lambda: None, tuple, tuple)


def waiting(interface, step):
    """The action on which the lesson goes on, once somebody has pressed; it waits in another thread."""
    actions = []

    def lesson():
        with contextlib.suppress(KeyboardInterrupt):
            actions.append(interface.ready(step))

    thread = threading.Thread(target=lesson)
    thread.start()
    until(lambda: interface.shown.waits, "it waits")
    return thread, actions


def test_of_two_people_who_press_at_once_one_presses(interface):
    thread, actions = waiting(interface, Step("review", "wave", 2, 2))
    number = interface.shown.number
    with pytest.raises(BadInput, match=MOVED_ON):
        interface.press(number, Action("skip"))
    interface.press(number, Action("drop", 1))
    interface.press(number, Action("drop", 1))
    thread.join()
    assert actions == [Action("drop", 1)]
    interface.press(number, Action("drop", 1))  # the same press, late
    thread, actions = waiting(interface, Step("review", "wave", 1, 2))
    for late in (GO, Action("more")):
        with pytest.raises(BadInput, match=MOVED_ON):
            interface.press(number, late)
    interface.press(interface.shown.number, GO)
    thread.join()
    assert actions == [GO]


def test_a_second_press_before_the_lesson_has_seen_the_first_is_refused(interface, monkeypatch):
    monkeypatch.setattr(interface, "_wait", lambda done, seconds: None)
    interface._set(interface.shown.__class__(Step("review", "wave", 2, 2), 1, True, ()))
    interface.press(1, GO)
    with pytest.raises(BadInput, match=PRESSED):
        interface.press(1, Action("more"))


def test_while_takes_go_on_presses_wait_for_the_pause_after_the_take(interface):
    interface.show(Step("countdown", "wave", 1, 5, left_s=3))
    interface.press(0, Action("pause"))
    interface.press(7, Action("pause"))
    with pytest.raises(BadInput, match=MOVED_ON):
        interface.press(0, GO)
    between = Step("between", "wave", 1, 5)
    assert interface.between(between, 0.0) == Action("pause") and interface.between(between, 0.0) == GO
    assert interface.shown.step == between


def test_an_ended_lesson_goes_no_further(interface):
    thread, actions = waiting(interface, Step("ready", "wave"))
    interface.end()
    thread.join()
    assert not actions
    with pytest.raises(KeyboardInterrupt):
        interface.pause(10.0)


class Pupil:
    """An observer on the mesh that keeps every take."""

    def __init__(self, link, keys, name):
        self.takes, self.labels, self.learned, self.last, self.answers = {}, [], None, None, True
        self.seats, self.asked = set(), []
        link.announce(keys.observer_alive(name))
        link.answer_requests(keys.teach(name), self.respond)

    def respond(self, payload):
        if not self.answers:
            return None
        request, tracks, corrected, forgotten = decode(TeachRequest, payload), None, None, None
        match request.command:
            case "status":
                self.seats.add(request.teacher)
            case "begin" if request.label:
                self.takes.setdefault(request.label, []).append(request.take)
                self.last = TakeReport(label=request.label, take=request.take, state="kept", seconds=1.5)
            case "drop":
                self.takes[request.label].remove(request.take)
            case "learn":
                self.learned = LearnedReport(labels=request.labels, results={"wave": {"wave": 2}})
            case "adopt":
                self.labels, self.learned = self.learned.labels, None
            case "correct" if request.to_ns == request.from_ns:
                self.takes[request.label].append(9)
                self.asked.append(request)
                times = {"from_ns": request.from_ns, "to_ns": request.to_ns, "seconds": 1.5}
                corrected = CorrectedReport(id=request.correction, label=request.label, **times)
            case "forget":
                self.takes.pop(request.label, None)
                forgotten = ForgottenReport(takes=2, in_model=request.label in self.labels)
            case "correct":
                times = {"from_ns": request.from_ns, "to_ns": request.to_ns, "seconds": 1.0}
                corrected = CorrectedReport(id=request.correction, label=request.label, **times)
            case "show":
                tracks = ShownTracks(body_parts=["head"], points=[500, request.take])
        return encode(
            TeachReply(
                state="learned" if self.learned else "idle", pictures=True, visible=True, takes=self.takes,
                take=self.last, labels=self.labels, learned=self.learned, tracks=tracks, corrected=corrected,
                forgotten=forgotten, persons={"anna": {}},
            )
        )  # fmt: skip


@pytest.fixture
def lesson_server(fusion, scene_file, request):
    """A lesson_server before two observers, of which cam2 does not run; and the observer."""
    scene = read_scene(scene_file(fusion.locator), {})
    participant = Pupil(fusion, scene.keys, "cam1")
    link = Link.open(scene.mesh, "hub")
    lesson_server = LessonServer(scene, link)
    request.addfinalizer(link.close)
    request.addfinalizer(lesson_server.close)
    lesson_server.looked()
    until(lambda: lesson_server.observers["cam1"], "the observer is found")
    return lesson_server, participant


def plan(labels=("wave", "clap"), teacher="a" * 16):
    return LessonPlan(list(labels), teacher, takes=2, background_s=0.0, countdown=0, test=True)


def press(lesson_server, kind, step, take=0, label=None):
    """Press it where the lesson waits for it."""

    def waits():
        shown = lesson_server.lesson.interface.shown
        return shown.waits and shown.step.kind == step and label in (None, shown.step.label)

    until(waits, lambda: lesson_server.lesson.interface.shown)
    number = lesson_server.lesson.interface.shown.number
    lesson_server.press(lesson_server.lesson.id, number, Action(kind, take))
    until(
        lambda: (
            lesson_server.lesson.over
            or lesson_server.lesson.interface.shown.number != number
            or not lesson_server.lesson.interface.shown.waits
        ),
        step,
    )


def test_a_whole_lesson_by_presses_and_a_correction(lesson_server, make):
    lesson_server, participant = lesson_server
    assert lesson_server.observers["cam2"] is None
    assert lesson_server.now("cam1").points == [500, 0] and lesson_server.take("cam1", "wave", 7).points == [500, 7]
    with pytest.raises(BadInput, match=r"'attic' is unknown; known: cam1, cam2"):
        lesson_server.now("attic")
    lesson_server.start(plan())
    with pytest.raises(BadInput, match=BUSY):
        lesson_server.start(plan(("nod", "bow")))
    press(lesson_server, "go", "ready", label="wave")
    press(lesson_server, "drop", "review", 1, label="wave")
    press(lesson_server, "more", "review", label="wave")
    press(lesson_server, "go", "review", label="wave")
    with pytest.raises(BadInput, match=MOVED_ON):
        lesson_server.press("another", lesson_server.lesson.interface.shown.number, GO)
    press(lesson_server, "go", "ready", label="clap")
    press(lesson_server, "go", "review", label="clap")
    assert participant.takes == {"wave": [2, 3], "clap": [1, 2]}
    press(lesson_server, "go", "learned")
    until(lambda: participant.labels, "it adopts")
    verdict = make.verdict(1, label="clap", ended_ns=make.NOON)
    fused = SimpleNamespace(
        labels=("wave", "clap"), now_ns=make.NOON, verdicts=(verdict,), observers=(), judgement=None
    )
    lesson_server.note(SceneUpdate(fused))
    press(lesson_server, "skip", "test")
    until(lambda: lesson_server.lesson.over, "it ends")
    assert lesson_server.lesson.fault == ""
    assert "cam1: wave 2 of 2" in [
        line.text for line in lesson_server.lesson.interface.shown.lines if line.kind == "learning"
    ]
    lesson_server.stop(lesson_server.lesson.id)
    assert lesson_server.lesson is None
    with pytest.raises(BadInput, match="no longer remember"):
        lesson_server.correct(WantedCorrections({"v9": "wave"}))
    lesson_server.correct(WantedCorrections({"v1": "wave"}))
    until(lambda: lesson_server.lesson.over, "it has learned from the correction")
    assert lesson_server.lesson.fault == ""
    assert "was wave by anna: kept by cam1 (1.0 s)" in lesson_server.lesson.interface.shown.lines[0].text


@pytest.fixture
def taught(lesson_server):
    """The same; the observer has been taught three movements, which the fusion service judges."""
    lesson_server, participant = lesson_server
    participant.labels = ["wave", "clap", "nod"]
    participant.takes = {"wave": [1, 2], "clap": [1, 2], "nod": [1]}
    fused = SimpleNamespace(now_ns=0, verdicts=(), observers=(), judgement=None)
    fused.labels = participant.labels
    lesson_server.note(SceneUpdate(fused))
    return lesson_server, participant


def lines(lesson_server):
    until(lambda: lesson_server.lesson.over, lambda: lesson_server.lesson.interface.shown)
    return [line.text for line in lesson_server.lesson.interface.shown.lines]


def test_a_missed_movement_is_shown_before_anybody_learns_from_it(taught):
    lesson_server, participant = taught
    for wanted, line in (
        (WantedCorrections(), "nothing was corrected"),
        (WantedCorrections(missed=[Missed("wave", 660.0)]), "no longer remember"),
    ):
        with pytest.raises(BadInput, match=line):
            lesson_server.correct(wanted)
    lesson_server.correct(WantedCorrections(missed=[Missed("wave", 5.0)], person="ben"))
    until(lambda: lesson_server.lesson.examples, "it is cut out")
    assert [(each.label, each.takes) for each in lesson_server.lesson.examples] == [("wave", {"cam1": 9})]
    press(lesson_server, "drop", "examples", 1)
    assert any("was wave by ben: kept by cam1" in line for line in lines(lesson_server))
    assert lesson_server.lesson.fault == NONE_LEFT and participant.takes["wave"] == [1, 2]
    lesson_server.correct(WantedCorrections(missed=[Missed("wave", 5.0)]))
    press(lesson_server, "go", "examples")
    assert lines(lesson_server)[-1] == "1 observer and the fusion service recognise wave, clap, nod from now on"
    (first, second) = participant.asked
    assert (first.person, second.person) == ("ben", "anna") and participant.takes["wave"] == [1, 2, 9]
    assert abs(time.time_ns() - 5 * SECOND_NS - second.from_ns) < 60 * SECOND_NS


def test_a_movement_is_forgotten_and_observers_that_do_not_run_are_named(taught):
    lesson_server, participant = taught
    fused = SimpleNamespace(labels=["wave", "clap"], now_ns=0, verdicts=(), observers=(), judgement=None)
    lesson_server.note(SceneUpdate(fused))
    lesson_server.forget(Unwanted(label="nod"), clips=False)
    assert "cam1: removed 2 takes; learns anew without it" in lines(lesson_server)
    assert participant.labels == ["wave", "clap"] and lesson_server.lesson.purpose == "forget"
    assert lesson_server.lesson.fault == "not forgotten by cam2: no answer; forget it again when it runs"


def test_a_lesson_stays_the_teacher_while_it_waits_and_says_why_it_ends(lesson_server):
    lesson_server, participant = lesson_server
    lesson_server.start(plan(teacher="b" * 16))
    until(lambda: lesson_server.lesson.interface.shown.waits, "it waits")
    participant.seats.clear()
    until(lambda: "b" * 16 in participant.seats, "the observer is asked by the lesson's teacher")
    lesson_server.stop(lesson_server.lesson.id)
    until(lambda: lesson_server.lesson.over, "it ends")
    assert lesson_server.lesson.fault == "every take is kept" and lesson_server.lesson.stopped


def test_observers_that_do_not_answer_a_teacher_are_one_line(lesson_server, monkeypatch):
    lesson_server, participant = lesson_server
    participant.answers = False
    monkeypatch.setattr(lesson_server._client, "_answer_s", 0.1)
    lesson_server.start(plan())
    until(lambda: lesson_server.lesson.over, "it ends")
    assert "labanmesh secure add SCENE NAME --hub --teach" in lesson_server.lesson.fault
    assert "\n" not in lesson_server.lesson.fault
    until(lambda: lesson_server.silent == {"cam1"}, "the page says so")
