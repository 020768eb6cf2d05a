"""The dashboard's web server: who may read, its headers, and a real mesh over real HTTP."""

import json
import re

import httpx
import pytest
from asgi_answers import answers_of
from played_scene import Dashboard
from processes import SOON_S

from common.address import Address
from common.arrival import CaptureRecord
from common.capture_file import CaptureWriter
from common.config import read_scene
from common.errors import BadInput, LabanmeshError
from common.wire import encode
from hub.dashboard.access import COOKIE, AccessControl, checked_token, is_loopback
from hub.dashboard.application import STATIC, application
from hub.dashboard.commands import dashboard
from hub.lan import bound_socket

TOKEN = "a-word-of-sixteen-and-more"  # noqa: S105 - a test


@pytest.mark.parametrize(
    ("address", "own"),
    [("127.0.0.1:8420", True), ("127.8.0.1:1", True), ("localhost:1", True), ("[::1]:80", True), ("[::]:80", False),
     ("0.0.0.0:8420", False), ("dojo.local:8420", False), ("192.168.1.5:80", False), ("localhost.evil:1", False)],
)  # fmt: skip
def test_loopback_is_what_only_this_machine_reaches(address, own):
    assert is_loopback(Address.parse(address, "listen")) == own


@pytest.mark.parametrize("text", ["", "short", "two words that are long enough", "ümlaut" * 5, "x" * 15])
def test_an_invalid_token_is_refused_and_not_revealed(text):
    with pytest.raises(BadInput, match="at least 16") as refused:
        checked_token(text, "hub.dashboard.token_file = t")
    assert not text or text not in str(refused.value)


def test_the_cookie_is_not_the_token_and_each_token_has_its_own():
    access, other = AccessControl(checked_token(f" {TOKEN}\n", "file")), AccessControl(f"{TOKEN}2")
    assert TOKEN not in access.cookie and access.cookie != other.cookie == AccessControl(f"{TOKEN}2").cookie
    assert access.admits(access.cookie, "") and access.admits("", f"Bearer {TOKEN}")
    for cookie, authorization in (("", ""), (TOKEN, ""), ("", TOKEN), ("", f"Bearer {TOKEN}x"), ("ü", "Bearer ü")):
        assert not access.admits(cookie, authorization)


async def one_event(head):
    yield b"event: state\ndata: %d\n\n" % head.at_s


def ask(*requests, access=None, full=False, host="127.0.0.1"):
    """The answers to (method, path, more) of one application."""
    app = application(access or AccessControl(None), one_event, lambda: full)
    return answers_of(app, *requests, host=host)


def test_the_page_loads_nothing_from_elsewhere():
    for answer in ask(*(("GET", path, {}) for path in STATIC)):
        assert answer.status_code == 200
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy and "unsafe" not in policy and "*" not in policy
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert not re.search(r"(src|href|url\()\W*https?:", answer.text)
        assert "innerHTML" not in answer.text and "style=" not in answer.text
    missing, written = ask(("GET", "/etc/passwd", {}), ("POST", "/events", {}))
    assert (missing.status_code, written.status_code) == (404, 405)


def test_a_foreign_name_for_this_machine_and_too_many_browsers_are_refused():
    for host in ("evil.example", "127.0.0.1.evil.example:8420"):
        assert ask(("GET", "/events", {}), host=host)[0].status_code == 421
    assert ask(("GET", "/events", {}), full=True)[0].status_code == 503


def test_the_token_admits():
    access = AccessControl(TOKEN)
    form, events, wrong, right, long = ask(
        ("GET", "/", {}),
        ("GET", "/events", {}),
        ("POST", "/enter", {"data": {"token": "wrong"}}),
        ("POST", "/enter", {"data": {"token": TOKEN}}),
        ("POST", "/enter", {"content": b"x" * 10_000}),
        access=access, host="dojo.local",
    )  # fmt: skip
    assert form.status_code == 401 and "<form" in form.text and "judge" not in form.text
    assert events.status_code == 401 and wrong.status_code == 401 and "That is not the token." in wrong.text
    cookie = right.headers["set-cookie"]
    assert right.status_code == 303 and "HttpOnly" in cookie and "SameSite=strict" in cookie and TOKEN not in cookie
    assert COOKIE not in wrong.cookies and long.status_code == 413
    page, bearer = ask(
        ("GET", "/", {"headers": {"cookie": f"{COOKIE}={access.cookie}"}}),
        ("GET", "/events?at=7", {"headers": {"authorization": f"Bearer {TOKEN}"}}),
        access=access, host="dojo.local",
    )  # fmt: skip
    assert "tatami" in page.text and "data: 7" in bearer.text


@pytest.mark.parametrize(
    "query", ["at=x", "at=nan", "at=-5", "at=", "at=1e308", "speed=inf", "speed=65", "speed=-1", f"at={'9' * 5000}"]
)
def test_an_absurd_playhead_is_400_and_one_line(query):
    answer, default = ask(("GET", f"/events?{query}", {}), ("GET", "/events", {}))
    assert answer.status_code == 400 and answer.text.count("\n") == 1 and len(answer.text) < 120
    assert f"{query.partition('=')[0]} = " in answer.text and "must be a number from 0 to" in answer.text
    assert "data: 0" in default.text


def refusal(error, *words, **more):
    with pytest.raises(error) as refused:
        dashboard(*words, **more)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_bad_input_is_one_line(scene_file, tmp_path):
    assert "either a scene file or a capture" in refusal(BadInput)
    assert "other machines can reach that" in refusal(BadInput, scene_file(), listen="[::]:0")
    assert "HOST:PORT" in refusal(BadInput, scene_file(text='[hub.dashboard]\nlisten = "8420"\n'))
    file = scene_file(text='[hub.dashboard]\ntoken_file = "token"\n')
    assert "openssl rand" in refusal(BadInput, file)
    (tmp_path / "token").write_text("short")
    assert "at least 16" in refusal(BadInput, file) and "short" not in refusal(BadInput, file)
    assert "labanmesh capture" in refusal(BadInput, capture=tmp_path / "nothing.mcap")


def test_a_port_in_use_is_one_line(scene_file):
    with bound_socket(Address("127.0.0.1", 0), "--listen") as port:
        where = f"127.0.0.1:{port.getsockname()[1]}"
        message = refusal(LabanmeshError, scene_file(), listen=where)
    assert where in message and "in use" in message and "--listen" in message


def events(lines):
    kind = ""
    for line in lines:
        if line.startswith("event: "):
            kind = line[7:]
        elif line.startswith("data: "):
            yield kind, json.loads(line[6:])


def test_a_verdict_on_the_mesh_reaches_a_browser(fusion, scene_file, make):
    fusion.answer("laban/room/vocabulary", lambda: encode(make.vocabulary()))
    publisher = fusion.publisher("laban/room/verdict")
    with (
        Dashboard(scene_file(fusion.locator)) as page,
        httpx.stream("GET", f"{page.url}events", timeout=SOON_S) as answer,
    ):
        received = events(answer.iter_lines())
        kind, whole = next(received)
        assert kind == "snapshot" and whole["scene"] == "room" and not whole["verdicts"]
        assert publisher.wait_for_subscriber(SOON_S)
        publisher.put(encode(make.verdict(1)))
        verdict = next(fields for kind, fields in received if kind == "verdict")
        assert verdict["label"] == "nthrow" and verdict["why"]


def test_a_page_that_is_open_ends_with_the_dashboard(scene_file, tmp_path, make):
    file, capture, began_ns = scene_file("tcp/127.0.0.1:1"), tmp_path / "capture.mcap", 10**18
    with CaptureWriter(capture, read_scene(file, {}), file.read_text(), began_ns) as writer:
        for key, message in (("vocabulary", make.vocabulary()), ("verdict", make.verdict(1))):
            writer.write(CaptureRecord("put", f"laban/room/{key}", encode(message), began_ns))
    with httpx.Client(timeout=SOON_S) as browser:
        with Dashboard("--capture", capture) as page:
            answer = browser.send(browser.build_request("GET", f"{page.url}events"), stream=True)
            received = events(answer.iter_lines())
            assert next(received)[0] == "snapshot"
        # The process has ended cleanly (see `Dashboard`), and so has the stream.
        assert "snapshot" not in dict(received)
