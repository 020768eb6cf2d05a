"""The Teach page's requests: who may teach, what a foreign page can do, and bad input in one line."""

import asyncio
import re

import httpx
import pytest
from asgi_answers import answers_of
from fake_lesson_server import FakeLessonServer
from processes import SOON_S

from common.address import Address
from common.errors import BadInput
from common.teaching_messages import Unwanted
from hub.dashboard.access import COOKIE, AccessControl
from hub.dashboard.application import application
from hub.dashboard.commands import _access, _teach_lines
from hub.dashboard.serving import NO_TEACH_RIGHT, _teach_page
from hub.dashboard.teach_routes import TEACHING_IS_OFF, TeachPage
from hub.teaching.interface import Action, Step
from hub.teaching.lesson_data import action_of, corrections_of, lesson_server_data, plan_of, unwanted_of
from hub.teaching.page_interface import PageInterface, PageLesson
from hub.teaching.page_memory import Missed, WantedCorrections

TOKEN = "a-word-of-sixteen-and-more"  # noqa: S105 - a test
BEARER = {"authorization": f"Bearer {TOKEN}"}
POSTS, TRACKS = ("start", "press", "stop", "correct", "forget", "enter"), ("now/cam1", "take/cam1/wave/1")
PAGE = ("GET", "/teach", {})
PLAN = {"labels": ["wave", "clap"], "takes": 3, "minutes": 1, "person": "anna"}


@pytest.fixture
def lesson_server(scene):
    return FakeLessonServer(scene)


def ask(lesson_server, *requests, access=None, off=TEACHING_IS_OFF, host="dojo.local"):
    """The answers to (method, path, more) of one application."""
    access = access or AccessControl(TOKEN, TOKEN)
    page = TeachPage(access, lesson_server, off, lesson_server.scene if lesson_server else None)
    return answers_of(application(access, None, lambda: False, None, page), *requests, host=host)


def post(path, fields, **headers):
    return "POST", f"/teach/{path}", {"json": fields, "headers": {**BEARER, **headers}}


def test_a_lesson_is_begun_pressed_and_stopped_by_those_who_have_the_token(lesson_server, caplog):
    caplog.set_level("INFO", "labanmesh.hub")
    press = {"lesson": "abc", "number": 4, "action": "drop", "take": 2}
    answers = ask(lesson_server, post("start", PLAN), post("press", press), post("stop", {"lesson": "abc"}))
    assert [each.status_code for each in answers] == [204] * 3
    (plan,) = lesson_server.plans
    assert (plan.labels, plan.takes, plan.background_s, plan.person) == (["wave", "clap"], 3, 60, "anna")
    assert lesson_server.pressed == [("abc", 4, Action("drop", 2))] and lesson_server.stopped == ["abc"]
    correction = {"labels": {"v1": "", "v2": "ok"}, "missed": [{"label": "ok", "ago_s": 4.5}], "person": " anna "}
    forgetting = ({"person": "anna"}, {"label": "nod", "clips": True}, {"everything": True})
    answers = ask(lesson_server, post("correct", correction), *(post("forget", fields) for fields in forgetting))
    assert {each.status_code for each in answers} == {204}
    assert lesson_server.corrected == [WantedCorrections({"v1": "", "v2": "ok"}, [Missed("ok", 4.5)], "anna")]
    assert lesson_server.forgotten == [
        (Unwanted("anna"), False), (Unwanted(label="nod"), True), (Unwanted(everything=True), False)
    ]  # fmt: skip
    kinds = [f"forgetting from the page: {kind}" for kind in ("a person", "a movement", "everything")]
    assert caplog.messages[-3:] == kinds, "a name that is forgotten does not stay in the log"
    again, now, unknown, missing, home = ask(
        lesson_server, post("start", PLAN), *(("GET", f"/teach/{path}", {"headers": BEARER})
        for path in ("now/cam1", "now/attic", "take/cam1/wave/3", "home")),
    )  # fmt: skip
    assert (again.status_code, again.text) == (409, "a lesson is going on\n")
    assert now.json()["points"] == [0, 1000] and now.headers["cache-control"] == "no-store"
    assert unknown.status_code == 409 and unknown.text == "observer 'attic' is unknown; known: cam1, cam2\n"
    takes = (f"take/cam1/wave/{'9' * 32}", f"take/cam1/wave/{'9' * 5000}", "take/cam1/wave/-1", "take/cam1/a b/1")
    answers = ask(lesson_server, *(("GET", f"/teach/{path}", {"headers": BEARER}) for path in takes))
    assert {(each.status_code, each.text) for each in answers} == {(404, "There is no such take.\n")}
    assert missing.status_code == 204 and not home.json()["connected"] and home.json()["steps"]


def test_nothing_is_taught_without_the_token_in_the_header(lesson_server, monkeypatch):
    monkeypatch.setattr("hub.dashboard.teach_routes.WRONG_TOKEN_S", 0.0)
    access = AccessControl(TOKEN, TOKEN)
    cookie = {"cookie": f"{COOKIE}={access.cookie}"}
    for headers in ({}, cookie, {"authorization": "Bearer wrong"}, {"authorization": f"Bearer {access.cookie}"}):
        requests = [("POST", f"/teach/{path}", {"json": PLAN, "headers": headers}) for path in POSTS]
        requests += [("GET", f"/teach/{path}", {"headers": headers}) for path in ("state", "home", *TRACKS)]
        assert {each.status_code for each in ask(lesson_server, *requests, access=access)} == {401}
    assert not (lesson_server.plans or lesson_server.pressed or lesson_server.stopped or lesson_server.looks)
    gets = [("GET", f"/teach/{path}", {"headers": BEARER}) for path in POSTS]
    assert {each.status_code for each in ask(lesson_server, *gets)} == {405}, "nothing changes by a GET"


def test_requests_that_wait_are_answered_when_the_server_ends(lesson_server):
    page = TeachPage(AccessControl(TOKEN, TOKEN), lesson_server, TEACHING_IS_OFF, lesson_server.scene)

    async def main():
        app = application(AccessControl(TOKEN, TOKEN), None, lambda: False, None, page)
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://dojo.local") as client:
            waits = asyncio.create_task(client.get("/teach/state?after=7", headers=BEARER))
            await asyncio.sleep(0)
            page.end()
            return await asyncio.wait_for(waits, SOON_S)

    assert asyncio.run(main()).json()["version"] == 7


def test_a_foreign_page_and_a_form_are_refused(lesson_server):
    foreign, cross, form, huge, words, ours = ask(
        lesson_server, post("start", PLAN, origin="http://evil.example"),
        post("start", PLAN, origin="http://dojo.local", **{"sec-fetch-site": "cross-site"}),
        ("POST", "/teach/start", {"data": {"labels": "wave"}, "headers": BEARER}),
        post("start", {"labels": ["x" * 9000]}),
        ("POST", "/teach/start", {"content": b"[", "headers": {**BEARER, "content-type": "application/json"}}),
        post("start", PLAN, origin="http://dojo.local"),
    )  # fmt: skip
    assert [each.status_code for each in (foreign, cross, form, huge, words, ours)] == [403, 403, 415, 409, 409, 204]
    assert all(each.text.count("\n") == 1 for each in (foreign, cross, form, huge, words))
    assert "access-control-allow-origin" not in foreign.headers and len(lesson_server.plans) == 1


def test_a_browser_keeps_a_key_made_from_the_token(lesson_server):
    enter = ("POST", "/teach/enter", {"headers": BEARER})
    entered, page, script = ask(lesson_server, enter, PAGE, ("GET", "/teach.js", {}))
    key, cookie = entered.json()["key"], entered.headers["set-cookie"]
    assert TOKEN not in entered.text + cookie and "HttpOnly" in cookie and "SameSite=strict" in cookie
    state, picture = ask(
        lesson_server, ("GET", "/teach/state", {"headers": {"authorization": f"Bearer {key}"}}),
        ("GET", "/picture/cam1", {"headers": {"cookie": cookie.partition(";")[0]}}),
    )  # fmt: skip
    assert state.json()["scene"] == "room" and picture.status_code == 404, "the cookie reads"
    assert page.status_code == script.status_code == 200, "the page itself shows nothing"
    for text in (page.text, script.text):
        assert not re.search(r"(src|href|url\()\W*https?:", text) and "innerHTML" not in text and "style=" not in text


def test_where_teaching_is_off_the_page_says_how_to_turn_it_on(scene, lesson_server):
    state = ("GET", "/teach/state", {"headers": BEARER})
    for access, off in (
        (AccessControl(None), TEACHING_IS_OFF),
        (AccessControl(TOKEN), TEACHING_IS_OFF),
        (AccessControl(TOKEN, "t"), NO_TEACH_RIGHT),
    ):
        forget = post("forget", {"everything": True})
        page, *others = ask(None, PAGE, state, post("start", PLAN), forget, access=access, off=off, host="127.0.0.1")
        assert page.status_code == 200 and off in page.text and {each.status_code for each in others} == {404}
    assert "labanmesh dashboard SCENE --teach" in TEACHING_IS_OFF
    assert "labanmesh secure add SCENE NAME --hub --teach" in NO_TEACH_RIGHT


@pytest.mark.parametrize(("teaches", "right", "line"), [(False, True, TEACHING_IS_OFF), (True, False, NO_TEACH_RIGHT)])
def test_a_certificate_without_the_right_does_not_teach(scene, monkeypatch, teaches, right, line):
    monkeypatch.setattr("hub.dashboard.serving.has_right", lambda scene, what: right and what == "teach")
    access = AccessControl(TOKEN, TOKEN if teaches else None)
    with _teach_page(access, scene, None) as (page, _):
        (answer,) = answers_of(application(access, None, lambda: False, None, page), PAGE, host="dojo.local")
        assert line in answer.text


def test_a_token_is_made_where_none_is_configured(tmp_path, scene, monkeypatch):
    (tmp_path / "token").write_text(TOKEN)
    local, lan = Address("127.0.0.1", 8420), Address("0.0.0.0", 8420)  # noqa: S104 - a test
    made = _access(local, None, True)
    assert re.fullmatch(r"([a-z2-9]{4}-){3}[a-z2-9]{4}", made.made_token)
    assert made.made_token != _access(local, None, True).made_token
    assert made.admits("", "") and made.admits_teaching(f"Bearer {made.made_token}") and not made.admits_teaching("")
    assert not _access(lan, None, True).admits("", ""), "others need it to read, too"
    own = _access(lan, tmp_path / "token", True)
    assert own.made_token == "" and own.admits_teaching(f"Bearer {TOKEN}") and own.admits("", f"Bearer {TOKEN}")
    assert not _access(lan, tmp_path / "token", False).admits_teaching(f"Bearer {TOKEN}")
    with pytest.raises(BadInput, match="token_file is not set"):
        _access(lan, None, False)
    lines = list(_teach_lines(scene, "s.toml", made, local))
    assert lines[0] == f"teach at http://127.0.0.1:8420/teach#{made.made_token}"
    assert lines[1] == "for a phone: labanmesh dashboard s.toml --teach --listen 0.0.0.0:8420"
    (line,) = _teach_lines(scene, "s.toml", own, lan)
    monkeypatch.setattr("hub.dashboard.commands.has_right", lambda scene, what: False)
    assert list(_teach_lines(scene, "s.toml", own, lan)) == [NO_TEACH_RIGHT]
    assert TOKEN not in line and lan.host not in line


@pytest.mark.parametrize(
    ("fields", "line"),
    [({"labels": []}, "name at least one movement"), ({}, "a list of names"), ({"labels": [3, 4]}, "a list of names"),
     ({"labels": ["wave"]}, "one movement alone cannot be told"), ({"labels": ["wave", " "]}, "has no name"),
     ({"labels": ["wave", "a/b"]}, "'a/b': use 1 to 64 lower"), ({"labels": ["wave", "wave"]}, "named twice"),
     ({"labels": ["wave", "abstain"]}, "choose another name"), ({"labels": ["wave", "rest"]}, "choose another name"),
     ({"labels": ["ok"], "add": True}, "one movement alone"),
     ({"labels": [f"m{n}" for n in range(31)]}, "at most 30"), ({**PLAN, "takes": 1}, "takes: a number from 2 to 20"),
     ({**PLAN, "takes": True}, "takes"), ({**PLAN, "minutes": 99}, "minutes: a number from 0 to 15"),
     ({**PLAN, "minutes": float("nan")}, "minutes"), ({**PLAN, "seconds": "3"}, "seconds: a number from 0.5 to 12"),
     ({**PLAN, "person": "a\nb"}, "who performs"), ({**PLAN, "begin": "key"}, "begin: one of still, clap, now"),
     ({**PLAN, "alarm_minutes": -1}, "alarm_minutes: a number from 0 to 15")],
)  # fmt: skip
def test_what_cannot_be_taught_is_one_line(fields, line):
    with pytest.raises(BadInput, match=re.escape(line)) as refused:
        plan_of(fields, ["ok"], "t" * 16)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("fields", "line"),
    [({"labels": ["v1"]}, "labels: what each verdict"), ({"labels": {"v1": 3}}, "labels: what each verdict"),
     ({"missed": "ok"}, "missed: at most 10"), ({"missed": [{}] * 11}, "at most 10"), ({"missed": [3]}, "missed"),
     ({"missed": [{"label": "ok", "ago_s": -1}]}, "ago_s: a number from 0 to 3600"),
     ({"missed": [{"label": "ok", "ago_s": float("nan")}]}, "ago_s"), ({"missed": [{}]}, "a movement is not taught"),
     ({"labels": {"v1": "okk"}}, "okk is not taught (did you mean ok?)"), ({"person": "a\nb"}, "who performs")],
)  # fmt: skip
def test_what_cannot_be_corrected_is_one_line(fields, line):
    with pytest.raises(BadInput, match=re.escape(line)) as refused:
        corrections_of(fields, ["ok"])
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("fields", "line"),
    [({}, "One of a person, a movement, and everything"), ({"person": " "}, "One of"),
     ({"everything": False}, "One of"), ({"everything": "yes"}, "One of"),
     ({"person": "anna", "label": "ok"}, "One of"), ({"label": ["ok"]}, "One of"),
     ({"label": "a/b"}, "'a/b': no movement can have this name"), ({"person": "x" * 65}, "at most 64")],
)  # fmt: skip
def test_what_is_to_be_forgotten_must_be_one_thing(fields, line):
    with pytest.raises(BadInput, match=re.escape(line)):
        unwanted_of(fields)


def test_one_movement_can_be_added_and_presses_are_checked():
    assert plan_of({"labels": ["nod"], "add": True}, ["ok"], "t" * 16).add
    for fields in ({}, {"action": "adopt"}, {"action": "drop", "take": -1}, {"action": "drop", "take": "1"}):
        with pytest.raises(BadInput, match="is expected"):
            action_of(fields)


def test_the_state_says_how_observers_and_lesson_stand(lesson_server, make):
    lesson_server.verdicts = [make.verdict(2, label="abstain"), make.verdict(1, ended_ns=make.NOON)]
    state = lesson_server_data(lesson_server)
    cam1, cam2 = state["observers"]
    assert state["known"] == ["ok"] and state["begun"] == ["nod"] and state["lesson"] is None
    assert cam1["ready"] and cam1["line"] == "sees somebody" and cam1["take"]["seconds"] == 1.4 and cam1["other"] == 61
    assert cam1["persons"] == {"anna": {"nod": 2, "ok": 1, "": 1}} and state["remembers"]
    assert cam2 == {"name": "cam2", "ready": False, "line": "does not run", "picture": False, "clips": False}
    began = (make.NOON - make.SECOND) // 10**6
    assert state["said"] == [
        {"id": "v2", "label": "", "began": began, "ended": False},
        {"id": "v1", "label": "nthrow", "began": began, "ended": True},
    ]
    interface = PageInterface(lambda: None, tuple, tuple)
    lesson_server.lesson = PageLesson("abc", plan_of(PLAN, [], "abc"), interface)
    interface.say("cam1: sees somebody")
    for number in (1, 2):
        interface.show(Step("now", "wave", number, 3))
        interface.say(f"wave {number} of 3: kept by cam1 (1.2 s)")
    interface.say("  cam2: nobody was seen")
    lesson = lesson_server_data(lesson_server)["lesson"]
    assert lesson["news"] == ["wave 2 of 3: kept by cam1 (1.2 s)", "  cam2: nobody was seen"]
    assert lesson["step"]["label"] == "wave" and not lesson["waits"] and not lesson["over"]
    interface.show(Step("learning", number=0, of=2))
    interface.say("cam1: wave 2 of 3")
    interface.show(Step("adopting"))
    interface.say("1 observer and the fusion service recognise wave from now on")
    interface.show(Step("now", "wave", is_test=True))
    interface.say("wave: recognised")
    interface.say("now 1.0 minutes of anything but the movements")
    interface.show(Step("alarms", number=1, left_s=3))
    interface.say("false alarm: wave")
    lesson = lesson_server_data(lesson_server)["lesson"]
    assert lesson["results"] == ["cam1: wave 2 of 3"] and lesson["test"] == ["wave: recognised", "false alarm: wave"]
    assert lesson["adopted"]
