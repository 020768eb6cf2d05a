"""Live pictures at the dashboard: asked for only while a browser watches, never stored, and why there is none."""

import pytest
from asgi_answers import answers_of
from processes import SOON_S, until

from common.config import MeshConfig
from common.keys import SceneKeys
from common.link import Link
from common.picture_message import PictureMessage
from common.wire import encode
from hub.dashboard.access import AccessControl
from hub.dashboard.application import application
from hub.dashboard.pictures import VIEWER_LEASE_S, PictureAnswer, PictureRelay

KEYS = SceneKeys("dojo")
JPEG = b"\xff\xd8 a picture"


def message(captured_ns, jpeg=JPEG):
    return encode(PictureMessage(captured_ns=captured_ns, width=320, height=240, jpeg=jpeg))


@pytest.fixture(scope="module")
def link():
    mesh = MeshConfig(mode="process", endpoint="tcp/127.0.0.1:0")
    with Link.open(mesh, "fusion") as opened:
        yield opened


def test_an_observer_is_subscribed_to_while_somebody_asks(link):
    now_s = [0.0]
    publisher = link.publisher(KEYS.picture("cam1"), priority="low")
    relay = PictureRelay(KEYS, {"cam1": 2.0}, link, True, lambda: now_s[0])
    assert not publisher.has_subscriber
    assert relay.newest("cam1") == PictureAnswer("none yet")
    assert publisher.wait_for_subscriber(SOON_S)
    publisher.put(message(2))
    until(lambda: relay.newest("cam1") == PictureAnswer("picture", 2, JPEG), "the picture")
    for payload in (b"nonsense", message(3, b"<svg onload=alert(1)>")):
        relay._watched["cam1"].inbox.put(KEYS.picture("cam1"), payload)
        assert relay.newest("cam1").captured_ns == 2, "what is no JPEG is not passed on"
    now_s[0] = VIEWER_LEASE_S - 0.1
    relay.end_unwatched()
    assert publisher.has_subscriber
    now_s[0] = VIEWER_LEASE_S + 0.1
    relay.end_unwatched()
    assert not publisher.has_subscriber
    assert relay.newest("cam1") == PictureAnswer("none yet"), "an old picture is not shown again"
    now_s[0] *= 3
    relay.end_unwatched()


def test_nothing_is_asked_for_that_is_switched_off_or_not_allowed(link):
    publisher = link.publisher(KEYS.picture("cam2"))
    assert PictureRelay(KEYS, {"cam1": 2.0}, link, True).newest("cam2").state == "switched off"
    assert PictureRelay(KEYS, {"cam2": 2.0}, link, False).newest("cam2").state == "no right"
    assert not publisher.has_subscriber


def ask(newest, *paths, access=None, **more):
    """The answers of one application to GET requests."""
    app = application(access or AccessControl(None), None, lambda: False, newest)
    return answers_of(app, *(("GET", path, more) for path in paths))


def test_the_newest_picture_is_a_jpeg_that_no_browser_stores():
    first, same, next_ = ask(
        lambda observer: PictureAnswer("picture", 7, JPEG), "/picture/cam1", "/picture/cam1?after=7",
        "/picture/cam1?after=6",
    )  # fmt: skip
    assert first.content == next_.content == JPEG and first.headers["content-type"] == "image/jpeg"
    assert first.headers["cache-control"] == "no-store" and first.headers["x-picture"] == "7"
    assert "default-src 'none'" in first.headers["content-security-policy"]
    assert same.status_code == 204 and not same.content


@pytest.mark.parametrize(
    ("state", "status", "reason"),
    [("none yet", 204, ""), ("switched off", 404, "picture_hz"), ("no right", 403, "--pictures")],
)
def test_why_there_is_no_picture(state, status, reason):
    (answer,) = ask(lambda observer: PictureAnswer(state), "/picture/cam1")
    assert answer.status_code == status and reason in answer.text and answer.text.count("\n") <= 1


def test_without_the_token_there_is_no_picture_and_of_a_capture_never():
    (answer,) = ask(lambda observer: PictureAnswer("picture", 7, JPEG), "/picture/cam1", access=AccessControl("x" * 16))
    assert answer.status_code == 401 and JPEG not in answer.content
    assert ask(None, "/picture/cam1")[0].status_code == 404
