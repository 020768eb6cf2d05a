"""What a phone asks of the lesson of its scene, and what its page is told."""

import pytest
from fake_lesson_server import FakeLessonServer

from common.config import Scene
from hub.phone.phone_messages import LessonRequest
from hub.phone.running import PhoneLessons
from hub.teaching.interface import Action
from hub.teaching.lesson_server import TEACHER_LEASE_S


class Desk:
    def __init__(self):
        self.now_s = 100.0
        scene = Scene.model_validate({"scene": "home", "observers": {"cam1": {"source": "phone"}}})
        self.server = FakeLessonServer(scene)
        self.lessons = PhoneLessons(self.server, lambda: self.now_s)

    def ask(self, ask, **more):
        return self.lessons.ask(LessonRequest(ask=ask, **more))


@pytest.fixture
def desk():
    return Desk()


def test_a_lesson_is_begun_pressed_and_stopped(desk):
    assert desk.ask("start", plan={"labels": ["wave", "clap"], "takes": 3}) == ""
    assert desk.ask("press", lesson="abc", number=4, action="drop", take=2) == ""
    assert desk.ask("stop", lesson="abc") == ""
    (plan,) = desk.server.plans
    assert (plan.labels, plan.takes, plan.begin) == (["wave", "clap"], 3, "still")
    assert desk.server.pressed == [("abc", 4, Action("drop", 2))] and desk.server.stopped == ["abc"]


@pytest.mark.parametrize(("plan", "line"), [
    ({}, "a list of names"),
    ({"labels": ["wave"]}, "at least two"),
    ({"labels": ["wave", "../x"]}, "lower case"),
    ({"labels": ["wave", "clap"], "takes": float("nan")}, "takes: a number"),
    ({"labels": ["wave", "clap"], "person": "x" * 200}, ""),
])  # fmt: skip
def test_bad_plans_are_one_line_and_begin_nothing(desk, plan, line):
    answer = desk.ask("start", plan=plan)
    assert line in answer and answer and "\n" not in answer and not desk.server.plans


def test_a_second_lesson_and_an_unknown_press_are_refused(desk):
    desk.ask("start", plan={"labels": ["wave", "clap"]})
    assert "going on" in desk.ask("start", plan={"labels": ["wave", "clap"]})
    assert "action" in desk.ask("press", lesson="abc", number=1, action="fly") and not desk.server.pressed


def test_pages_get_the_lesson_while_somebody_looks(desk):
    assert desk.lessons.data() is None
    assert desk.ask("look") == "" and desk.server.looks == 1 and desk.lessons.data()["scene"] == "home"
    desk.now_s += TEACHER_LEASE_S
    assert desk.lessons.data() is None
