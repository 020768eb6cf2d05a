"""A lesson that pages show: who may press what and when, and one lesson for everybody, over a real mesh."""

import contextlib
import threading
from types import SimpleNamespace

import pytest
from played_scene import until

from common.config import read_scene
from common.errors import BadInput
from common.link import Link
from common.teaching_messages import CorrectedReport, LearnedReport, ShownTracks, TakeReport, TeachReply, TeachRequest
from common.wire import decode, encode
from hub.session import SceneUpdate
from hub.teaching.desk import BUSY, TeachDesk
from hub.teaching.lesson import LessonPlan
from hub.teaching.page_room import MOVED_ON, PRESSED, PageRoom
from hub.teaching.room import GO, Action, Step


@pytest.fixture
def room():
    return PageRoom(lambda: None, tuple, tuple)


def waiting(room, step):
    """The action on which the lesson goes on, once somebody has pressed; it waits in another thread."""
    actions = []

    def lesson():
        with contextlib.suppress(KeyboardInterrupt):
            actions.append(room.ready(step))

    thread = threading.Thread(target=lesson)
    thread.start()
    until(lambda: room.shown.waits, "it waits")
    return thread, actions


def test_of_two_people_who_press_at_once_one_presses(room):
    thread, actions = waiting(room, Step("review", "wave", 2, 2))
    number = room.shown.number
    with pytest.raises(BadInput, match=MOVED_ON):
        room.press(number, Action("skip"))
    room.press(number, Action("drop", 1))
    room.press(number, Action("drop", 1))
    thread.join()
    assert actions == [Action("drop", 1)]
    room.press(number, Action("drop", 1))  # the same press, late
    thread, actions = waiting(room, Step("review", "wave", 1, 2))
    for late in (GO, Action("more")):
        with pytest.raises(BadInput, match=MOVED_ON):
            room.press(number, late)
    room.press(room.shown.number, GO)
    thread.join()
    assert actions == [GO]


def test_a_second_press_before_the_lesson_has_seen_the_first_is_refused(room, monkeypatch):
    monkeypatch.setattr(room, "_wait", lambda done, seconds: None)
    room._set(room.shown.__class__(Step("review", "wave", 2, 2), 1, True, ()))
    room.press(1, GO)
    with pytest.raises(BadInput, match=PRESSED):
        room.press(1, Action("more"))


def test_while_takes_go_on_presses_wait_for_the_pause_after_the_take(room):
    room.show(Step("countdown", "wave", 1, 5, left_s=3))
    room.press(0, Action("pause"))
    room.press(7, Action("pause"))
    with pytest.raises(BadInput, match=MOVED_ON):
        room.press(0, GO)
    between = Step("between", "wave", 1, 5)
    assert room.between(between, 0.0) == Action("pause") and room.between(between, 0.0) == GO
    assert room.shown.step == between


def test_an_ended_lesson_goes_no_further(room):
    thread, actions = waiting(room, Step("ready", "wave"))
    room.end()
    thread.join()
    assert not actions
    with pytest.raises(KeyboardInterrupt):
        room.pause(10.0)


class Pupil:
    """An observer on the mesh that keeps every take."""

    def __init__(self, link, keys, name):
        self.takes, self.labels, self.learned, self.last, self.answers = {}, [], None, None, True
        self.seats = set()
        link.announce(keys.observer_alive(name))
        link.answer_requests(keys.teach(name), self.respond)

    def respond(self, payload):
        if not self.answers:
            return None
        request, tracks, corrected = decode(TeachRequest, payload), None, None
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
            case "correct":
                times = {"from_ns": request.from_ns, "to_ns": request.to_ns, "seconds": 1.0}
                corrected = CorrectedReport(id=request.correction, label=request.label, **times)
            case "show":
                tracks = ShownTracks(body_parts=["head"], points=[500, request.take])
        return encode(
            TeachReply(
                state="learned" if self.learned else "idle", pictures=True, visible=True, takes=self.takes,
                take=self.last, labels=self.labels, learned=self.learned, tracks=tracks, corrected=corrected,
            )
        )  # fmt: skip


@pytest.fixture
def desk(fusion, scene_file, request):
    """A desk before two observers, of which cam2 does not run; and the observer."""
    scene = read_scene(scene_file(fusion.locator), {})
    pupil = Pupil(fusion, scene.keys, "cam1")
    link = Link.open(scene.mesh, "hub")
    desk = TeachDesk(scene, link)
    request.addfinalizer(link.close)
    request.addfinalizer(desk.close)
    desk.looked()
    until(lambda: desk.observers["cam1"], "the observer is found")
    return desk, pupil


def plan(labels=("wave", "clap"), teacher="a" * 16):
    return LessonPlan(list(labels), teacher, takes=2, background_s=0.0, countdown=0, test=True)


def press(desk, kind, step, take=0, label=None):
    """Press it where the lesson waits for it."""

    def waits():
        shown = desk.lesson.room.shown
        return shown.waits and shown.step.kind == step and label in (None, shown.step.label)

    until(waits, lambda: desk.lesson.room.shown)
    number = desk.lesson.room.shown.number
    desk.press(desk.lesson.id, number, Action(kind, take))
    until(lambda: desk.lesson.over or desk.lesson.room.shown.number != number or not desk.lesson.room.shown.waits, step)


def test_a_whole_lesson_by_presses_and_a_correction(desk, make):
    desk, pupil = desk
    assert desk.observers["cam2"] is None
    assert desk.now("cam1").points == [500, 0] and desk.take("cam1", "wave", 7).points == [500, 7]
    with pytest.raises(BadInput, match=r"'attic' is unknown; known: cam1, cam2"):
        desk.now("attic")
    desk.start(plan())
    with pytest.raises(BadInput, match=BUSY):
        desk.start(plan(("nod", "bow")))
    press(desk, "go", "ready", label="wave")
    press(desk, "drop", "review", 1, label="wave")
    press(desk, "more", "review", label="wave")
    press(desk, "go", "review", label="wave")
    with pytest.raises(BadInput, match=MOVED_ON):
        desk.press("another", desk.lesson.room.shown.number, GO)
    press(desk, "go", "ready", label="clap")
    press(desk, "go", "review", label="clap")
    assert pupil.takes == {"wave": [2, 3], "clap": [1, 2]}
    press(desk, "go", "learned")
    until(lambda: pupil.labels, "it adopts")
    verdict = make.verdict(1, label="clap", ended_ns=make.NOON)
    fused = SimpleNamespace(labels=("wave", "clap"), now_ns=make.NOON, verdicts=(verdict,), observers=())
    desk.note(SceneUpdate(fused))
    press(desk, "skip", "test")
    until(lambda: desk.lesson.over, "it ends")
    assert desk.lesson.fault == ""
    assert "cam1: wave 2 of 2" in [line.text for line in desk.lesson.room.shown.lines if line.kind == "learning"]
    desk.stop(desk.lesson.id)
    assert desk.lesson is None
    with pytest.raises(BadInput, match="no longer remember"):
        desk.correct({"v9": "wave"})
    desk.correct({"v1": "wave"})
    until(lambda: desk.lesson.over, "it has learned from the correction")
    assert desk.lesson.fault == "" and "was wave: kept by cam1 (1.0 s)" in desk.lesson.room.shown.lines[0].text


def test_a_lesson_keeps_its_seat_while_it_waits_and_says_why_it_ends(desk):
    desk, pupil = desk
    desk.start(plan(teacher="b" * 16))
    until(lambda: desk.lesson.room.shown.waits, "it waits")
    pupil.seats.clear()
    until(lambda: "b" * 16 in pupil.seats, "the observer is asked by the lesson's teacher")
    desk.stop(desk.lesson.id)
    until(lambda: desk.lesson.over, "it ends")
    assert desk.lesson.fault == "every take is kept" and desk.lesson.stopped


def test_observers_that_do_not_answer_a_teacher_are_one_line(desk, monkeypatch):
    desk, pupil = desk
    pupil.answers = False
    monkeypatch.setattr(desk._classroom, "_answer_s", 0.1)
    desk.start(plan())
    until(lambda: desk.lesson.over, "it ends")
    assert "labanmesh secure add SCENE NAME --hub --teach" in desk.lesson.fault and "\n" not in desk.lesson.fault
    until(lambda: desk.silent == {"cam1"}, "the page says so")
